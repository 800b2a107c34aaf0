/* A control valve that sticks, as stemwatch fitted it.

     OP --curve--> command --dead time--> lag --> ringing --> speed limit --> air supply --> force
        --stick-slip--> stem --play--> position

   The stick-slip element is the canonical one of Choudhury, Thornhill and Shah (2005,
   doi:10.1016/j.conengprac.2004.05.005): a stem at rest breaks away when the force on it exceeds
   (S + J)/2 and follows (S - J)/2 behind it until it stops. Every parameter has a neutral value at
   which its effect is not there; names, units and meanings stand in modelDescription.xml.

   The valve moves once every sample_time. Nothing here knows of FMI: see fmi3.c. */

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "start_values.h"

enum {
#define PLACE(name, value) name,
    PARAMETERS(PLACE)
#undef PLACE
    N_PARAMETERS
};

#define ROUNDING 1e-9       /* percent; a smaller step of the force is a held command */
#define SOFTEST 0.5         /* least rise of spring and force together over a percent of travel */
#define STANDS_BELOW 0.01   /* percent per second; a stem that drags and is slower stands */
#define NO_LAG 1e-3         /* in units of the fit's own clock, of UNIT_S seconds */
#define PLACES 141          /* of the tables over travel: one for each percent from -20 to 120 */
#define PLACE_LOW (-20.0)
#define NEAR 0.98           /* share of the level, from which a stem gives way as there */
#define PI 3.141592653589793
#define MOTOR_PARTS 4       /* of a sample, in which a stem with inertia is moved */
#define ELEMENTS 3          /* of a spring with inner friction */
#define LONGEST_DELAY 10000000.0 /* samples */

typedef struct {
    double q[N_PARAMETERS];
#if CURVE_POINTS > 0
    double curve_op[CURVE_POINTS], curve_travel[CURVE_POINTS];
#endif
    double op, position;
    /* What the parameters amount to, for a sample. */
    double lag_up, lag_down, most_up, most_down, late;
    double ring_ee, ring_ve, ring_ev, ring_vv;
    double friction[PLACES], force[PLACES];
    long delay;
    /* The actuator: the commands that are still on their way, and the stages behind them. */
    double *waiting;
    long next;
    double lagged, rung, rung_speed, limited, step, air, before_air;
    /* The stem: its place, where its reading stands, the way and speed it moves, how long it rested. */
    double x, z, way, speed;
    double left; /* of the force on it, after it has moved */
    double anchor[ELEMENTS]; /* of the elements of the spring's inner friction */
    bool moving;
    double rested;
    double age; /* samples since the start */
} Valve;

static double share_of(double dt, double lag_s)
{
    return lag_s > NO_LAG * UNIT_S ? 1.0 - exp(-dt / lag_s) : 1.0;
}

static double clipped(double value, double low, double high)
{
    return fmin(fmax(value, low), high);
}

/* Percent of travel that OP asks for. */
static double command_of(const Valve *v)
{
#if CURVE_POINTS > 0
    const double *op = v->curve_op, *travel = v->curve_travel;
    int i = 0;
    if (v->op <= op[0]) return travel[0];
    if (v->op >= op[CURVE_POINTS - 1]) return travel[CURVE_POINTS - 1];
    while (v->op >= op[i + 1]) i++;
    return (travel[i + 1] - travel[i]) / (op[i + 1] - op[i]) * (v->op - op[i]) + travel[i];
#else
    return v->op;
#endif
}

static double table_at(const double *table, double x)
{
    double place = clipped(x - PLACE_LOW, 0.0, PLACES - 1.000001);
    int i = (int)place;
    return table[i] + (place - i) * (table[i + 1] - table[i]);
}

/* Ringing of second order while the command rests: where a unit of error (e) and of velocity (v)
   goes in a sample. */
static void prepare_ringing(Valve *v)
{
    double dt = v->q[SAMPLE_TIME], wn = v->q[RING_FREQUENCY];
    int steps = (int)fmax(10.0, ceil(dt / UNIT_S / 0.1 - 1e-9));
    double h = dt / steps, pull = h * wn * wn, kept = 1.0 - 2.0 * h * v->q[RING_DAMPING] * wn;
    v->ring_ee = v->ring_vv = 1.0;
    v->ring_ve = v->ring_ev = 0.0;
    for (int i = 0; i < steps; i++) {
        v->ring_ve = kept * v->ring_ve - pull * v->ring_ee;
        v->ring_ee += h * v->ring_ve;
        v->ring_vv = kept * v->ring_vv - pull * v->ring_ev;
        v->ring_ev += h * v->ring_vv;
    }
}

/* Friction and force over the travel. */
static void prepare_tables(Valve *v)
{
    const double *q = v->q;
    for (int i = 0; i < PLACES; i++) {
        double x = PLACE_LOW + i, share = x / 100.0, off = (x - q[TIGHT_PLACE]) / q[TIGHT_WIDTH];
        double z = clipped(x / 50.0 - 1.0, -1.0, 1.0);
        v->friction[i] = fabs(off) < 6.0 ? q[TIGHT_FRICTION] * exp(-off * off) : 0.0;
        v->force[i] = q[FLOW_FORCE] * (4.0 * share * (1.0 - share) - 1.0)
            + (q[LOAD_LINEAR] * z + q[LOAD_SQUARE] * (z * z) + q[LOAD_CUBE] * (z * z * z));
    }
}

/* What the parameters amount to; called again where one was tuned. */
static void prepare(Valve *v)
{
    const double *q = v->q;
    double dt = q[SAMPLE_TIME];
    v->lag_up = share_of(dt, q[LAG_RISING]);
    v->lag_down = share_of(dt, q[LAG_FALLING]);
    v->most_up = q[SPEED_RISING] * dt;
    v->most_down = q[SPEED_FALLING] * dt;
    prepare_ringing(v);
    prepare_tables(v);
}

/* How much of record_time is over, 0 to 1. */
static double course(const Valve *v)
{
    return fmin(v->age * v->q[SAMPLE_TIME] / v->q[RECORD_TIME], 1.0);
}

/* What is read where the stem is at 50 % of travel. */
static double reading_at_50(const Valve *v)
{
    const double *q = v->q;
    double t = course(v), waves = q[READING_WAVE_1] * sin(PI * t);
    waves += q[READING_WAVE_2] * sin(2.0 * PI * t) + q[READING_WAVE_3] * sin(3.0 * PI * t);
    return 50.0 + q[READING_ZERO] + q[READING_DRIFT] * (t - 0.5) + waves;
}

static double reading(const Valve *v)
{
    return v->q[READING_GAIN] * (v->z - 50.0) + reading_at_50(v);
}

/* Every state from the present OP; the stem stands at position_start, or as near as friction lets
   it. False where there is no memory for the dead time. */
static bool restart(Valve *v)
{
    double late = v->q[DEAD_TIME] / v->q[SAMPLE_TIME], command = command_of(v);
    if (!(late >= 0.0 && late <= LONGEST_DELAY)) return false;
    v->delay = (long)late;
    v->late = late - (double)v->delay;
    free(v->waiting);
    v->waiting = malloc((size_t)(v->delay + 2) * sizeof(double));
    if (v->waiting == NULL) return false;
    for (long i = 0; i < v->delay + 2; i++) v->waiting[i] = command;
    v->next = 0;
    prepare(v);
    v->lagged = v->rung = v->limited = v->before_air = command;
    v->rung_speed = v->step = v->air = v->speed = v->rested = v->age = 0.0;
    v->way = 1.0;
    v->moving = false;
    double per_op = fabs(v->q[TRAVEL_PER_OP]);
    double band = fabs(0.5 * (v->q[S] + v->q[J]) * per_op) + 0.5 * v->q[PLAY];
    double z = (v->q[POSITION_START] - reading_at_50(v)) / v->q[READING_GAIN] + 50.0;
    band += fabs(table_at(v->friction, z)) + fabs(table_at(v->force, z));
    band += v->q[SPRING_HYSTERESIS];
    v->x = v->z = clipped(z, command - band, command + band);
    v->left = command - v->x - table_at(v->force, v->x);
    double reach = v->q[SPRING_WAY] / 4.0, share = (command - v->x) / fmax(band, ROUNDING);
    for (int i = 0; i < ELEMENTS; i++, reach *= 2.0) v->anchor[i] = v->x - share * reach;
    v->position = reading(v);
    return true;
}

/* The command as it was dead_time ago, on the line between two samples. */
static double delayed(Valve *v, double command)
{
    long size = v->delay + 2;
    v->waiting[v->next] = command;
    double came = v->waiting[(v->next + 2) % size], earlier = v->waiting[(v->next + 1) % size];
    v->next = (v->next + 1) % size;
    return came + v->late * (earlier - came);
}

static double towards(double from, double to, double most_up, double most_down)
{
    double error = to - from;
    if (error <= most_up && -error <= most_down) return to;
    return from + (error > 0.0 ? most_up : -most_down);
}

/* Lag and speed limit as one device, whose step is limited. */
static double one_actuator(Valve *v, double u)
{
    double error = u - v->limited;
    v->step = clipped(error * (error > 0.0 ? v->lag_up : v->lag_down), -v->most_down, v->most_up);
    v->limited += v->step;
    return v->limited;
}

/* Lag, ringing and speed limit one after the other. */
static double actuators_in_turn(Valve *v, double u)
{
    double error = u - v->lagged;
    v->lagged += (error > 0.0 ? v->lag_up : v->lag_down) * error;
    error = v->rung - v->lagged;
    v->rung = v->lagged;
    if (v->q[RING_FREQUENCY] > 0.0) {
        v->rung += v->ring_ee * error + v->ring_ev * v->rung_speed;
        v->rung_speed = v->ring_ve * error + v->ring_vv * v->rung_speed;
    } else {
        v->rung_speed = 0.0;
    }
    return v->limited = towards(v->limited, v->rung, v->most_up, v->most_down);
}

/* The force on the stem, percent of travel: what delay, actuator and air make of the command. */
static double force_of(Valve *v)
{
    const double *q = v->q;
    double u = delayed(v, command_of(v)), side = q[SUPPLY_SAG] > 0.0 ? 1.0 : -1.0;
    u = ONE_ACTUATOR ? one_actuator(v, u) : actuators_in_turn(v, u);
    v->air = fmax(1.0 - q[SAMPLE_TIME] / q[SUPPLY_RECOVERY], 0.0) * v->air
        + fabs(q[SUPPLY_SAG]) / 100.0 * fmax(side * (u - v->before_air), 0.0);
    v->before_air = u;
    return u - side * v->air;
}

typedef struct {
    double breaks_up, breaks_down, slides_up, slides_down;
} Levels;

static Levels levels_of(const Valve *v)
{
    const double *q = v->q;
    double grown = fabs(q[TRAVEL_PER_OP]) * (1.0 + q[FRICTION_GROWTH] * course(v));
    double friction = table_at(v->friction, v->x);
    double level = 0.5 * q[S] * grown + friction, jump = 0.5 * q[J] * grown;
    double up = jump * (1.0 + q[SLIP_ASYMMETRY]), down = jump * (1.0 - q[SLIP_ASYMMETRY]);
    double rise = q[DWELL_BREAKAWAY]
        * log1p((v->moving ? 0.0 : v->rested) * q[SAMPLE_TIME] / q[DWELL_TIME]);
    Levels levels = {level + up + rise, level + down + rise, level - up, level - down};
    return levels;
}

/* The stem with a motor's inertia: its force balance in implicit steps, stable for every drag. The
   motor pushes by what is left of its way, up to the limit of its voltage; the load pulls back. */
static void move_with_inertia(Valve *v, double goal, double load, Levels at)
{
    const double *q = v->q;
    double h = q[SAMPLE_TIME] / MOTOR_PARTS, inertia = q[DRAG] * q[RUN_UP] / h, x = v->x;
    int limited = q[DRAG] > 0.0 && q[TOP_SPEED] < 1e6; /* from there on there is none */
    double most = limited ? q[DRAG] * q[TOP_SPEED] : INFINITY;
    for (int part = 0; part < MOTOR_PARTS; part++) {
        double f = clipped(goal - x, -most, most) - load;
        double gives = fabs(goal - x) < most ? h : 0.0;
        if (v->speed <= 0.0) {
            if (!(f > at.breaks_up || -f > at.breaks_down)) break;
            v->way = f > at.breaks_up ? 1.0 : -1.0;
        }
        double gap = v->way * f - (v->way > 0.0 ? at.slides_up : at.slides_down);
        v->speed = fmax((inertia * v->speed + gap) / (inertia + q[DRAG] + gives), 0.0);
        x += v->way * v->speed * h;
    }
    v->x = clipped(x, q[STOP_LOW], q[STOP_HIGH]);
    if (v->x != x) v->speed = 0.0;
    v->moving = v->speed > 0.0;
}

/* What the inner friction of the spring holds back where the stem is. Its elements slip at their
   reach, a quarter, a half and the whole of spring_way, and their anchors are dragged along. */
static double held_back(Valve *v)
{
    double shares = 0.0, reach = v->q[SPRING_WAY] / 4.0;
    for (int i = 0; i < ELEMENTS; i++, reach *= 2.0) {
        v->anchor[i] = clipped(v->anchor[i], v->x - reach, v->x + reach);
        shares += (v->x - v->anchor[i]) / reach;
    }
    return v->q[SPRING_HYSTERESIS] * shares / ELEMENTS;
}

/* The mean rise of the inner friction over a percent of the travel that closes a gap. */
static double stiffened(const Valve *v, double side, double gap)
{
    double slides = 0.0;
    if (v->q[SPRING_HYSTERESIS] <= 0.0 || gap <= 0.0) return 0.0;
    for (int round = 0; round <= ELEMENTS; round++) {
        double slope = 1.0, closed = 0.0, reach = v->q[SPRING_WAY] / 4.0;
        for (int i = 0; i < ELEMENTS; i++, reach *= 2.0) {
            double room = reach - side * (v->x - v->anchor[i]);
            double rise = v->q[SPRING_HYSTERESIS] / (ELEMENTS * reach);
            if (room > slides) slope += rise;
            else closed += rise * fmax(room, 0.0);
        }
        slides = (gap - closed) / slope;
    }
    return gap / slides - 1.0;
}

/* The share of the gap that the stem covers in a sample: a force that rises over the travel closes
   the gap on the way, as a stiffer spring would. */
static double slide_share(const Valve *v, double force)
{
    int i = (int)clipped(v->x - PLACE_LOW, 0.0, PLACES - 1.000001);
    double f = force - v->x, sliding = 0.5 * (v->q[S] - v->q[J]) * fabs(v->q[TRAVEL_PER_OP]);
    double stiffness = 1.0 + v->force[i + 1] - v->force[i];
    stiffness = fmax(stiffness + stiffened(v, f > 0.0 ? 1.0 : -1.0, fabs(f) - sliding), SOFTEST);
    return share_of(v->q[SAMPLE_TIME] * stiffness, v->q[DRAG]) / stiffness;
}

/* The gap below which a moving stem sticks. */
static double least_gap(const Valve *v, double share)
{
    double speed = v->q[RESTICK_SPEED], stands = STANDS_BELOW / UNIT_S;
    if (speed < 0.0) return -ROUNDING;
    if (v->q[DRAG] > NO_LAG * UNIT_S) speed = fmax(speed, stands);
    return fmax(speed * v->q[SAMPLE_TIME] / share, ROUNDING);
}

/* The way of a stem at rest to a share of its level, in deflections at the level. */
static double way_to(double share)
{
    return share < NEAR ? -log(1.0 - share) : -log(1.0 - NEAR) + (share - NEAR) / (1.0 - NEAR);
}

/* How far a stem at rest gives way to the change of the force on it. */
static double given_way(const Valve *v, double f, Levels at)
{
    double side = f > v->left ? 1.0 : -1.0, gives = v->q[GIVES];
    double level = fmax(side > 0.0 ? at.breaks_up : at.breaks_down, 1e-3), last = side * f / level;
    if (gives <= 0.0 || f == v->left) return 0.0;
    double way = gives * level * (way_to(last) - way_to(side * v->left / level));
    return side * way / (1.0 + gives / (1.0 - fmin(last, NEAR)));
}

/* A stem that sticks, breaks away, slides and stops. */
static void move(Valve *v, double force, Levels at)
{
    const double *q = v->q;
    double share = slide_share(v, force);
    double f = force - v->x, sliding = v->way > 0.0 ? at.slides_up : at.slides_down;
    bool rises = f > at.breaks_up, falls = -f > at.breaks_down;
    bool goes_on = ONE_ACTUATOR ? v->way * v->step > q[RESTICK_SPEED] * q[SAMPLE_TIME]
                                : v->way * f - sliding > least_gap(v, share);
    v->moving = v->moving && goes_on;
    if (!v->moving && (rises || falls)) {
        v->moving = true;
        v->way = rises ? 1.0 : -1.0;
        sliding = rises ? at.slides_up : at.slides_down;
    }
    if (!v->moving)
        v->x += q[CREEP] * q[SAMPLE_TIME] + given_way(v, f, at);
    else if (ONE_ACTUATOR) /* J above S: it slides ahead of its force, which in turn it may not */
        v->x = force - v->way * sliding;
    else
        v->x += share * v->way * fmax(v->way * f - sliding, 0.0);
    v->left = force - v->x;
    v->x = clipped(v->x, q[STOP_LOW], q[STOP_HIGH]);
}

/* One sample of the valve. */
static void advance(Valve *v)
{
    double force = force_of(v), half = 0.5 * v->q[PLAY];
    v->age += 1.0;
    Levels at = levels_of(v);
    double load = table_at(v->force, v->x) + held_back(v);
    v->rested = v->moving ? 1.0 : v->rested + 1.0;
    if (v->q[RUN_UP] > 0.0) move_with_inertia(v, force, load, at);
    else move(v, force - load, at);
    v->z = clipped(v->z, v->x - half, v->x + half);
    v->position = reading(v);
}
