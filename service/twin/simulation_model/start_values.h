/* A valve as it was fitted: the values that a parameter has until it is set. */

#define INSTANTIATION_TOKEN "{{ token }}"

/* 1: lag and speed limit are one device, and the stem slides while its command moves, as in the fit
   of S and J alone. 0: devices in turn, as in the fit with named effects. */
#define ONE_ACTUATOR {{ 1 if chain.one_actuator else 0 }}

/* Seconds in a unit of the clock on which the valve was fitted. */
#define UNIT_S {{ chain.unit_s | exact }}

#define OP_START {{ chain.op_start | exact }}

/* Value references follow this order. */
#define PARAMETERS(P) \
{% for one in parameters %}
    P({{ one.name | upper }}, {{ one.value | exact }}){{ "" if loop.last else " \\" }}
{% endfor %}

#define TUNABLE_PARAMETERS {{ parameters | map(attribute="tunable") | map("int") | join(", ") }}

/* The curve from OP to stroke, both in percent; without points OP is percent of travel. */
#define CURVE_POINTS {{ curve_op | length }}
#define CURVE_OP_VALUES {{ curve_op | map("exact") | join(", ") }}
#define CURVE_TRAVEL_VALUES {{ curve_travel | map("exact") | join(", ") }}
