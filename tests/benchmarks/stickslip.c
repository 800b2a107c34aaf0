/* The chain of models/stickslip/kernel.py as a straight C loop: what the compiled kernel is
 * measured against. Parameters: S, J, dead time, lag up, lag down, rate up, rate down, zero, gain,
 * re-stick; the whole state is taken from the measurement at sample 0 only. */
#include <math.h>

static double clamp(double v, double low, double high) {
    return v < low ? low : (v > high ? high : v);
}

void simulate(const double *op, const double *mv, long n, double dt, const double *q, double *out) {
    const double fs = 0.5 * (q[0] + q[1]), fd = 0.5 * (q[0] - q[1]);
    const double a_up = q[3] > 1e-3 ? 1.0 - exp(-dt / q[3]) : 1.0;
    const double a_dn = q[4] > 1e-3 ? 1.0 - exp(-dt / q[4]) : 1.0;
    const double most_up = q[5] * dt, most_dn = q[6] * dt, restick = q[9] * dt;
    const long whole = (long)(q[2] / dt);
    const double late = q[2] / dt - (double)whole;
    double p = op[0], d = 1.0;
    double x = clamp((mv[0] - q[7]) / q[8], op[0] - fabs(fs), op[0] + fabs(fs));
    int moving = 0;
    out[0] = q[8] * x + q[7];
    for (long k = 1; k < n; k++) {
        const long i = k > whole ? k - whole : 0;
        const double uc = op[i] + late * (op[i > 0 ? i - 1 : 0] - op[i]);
        const double error = uc - p;
        const double step = clamp(error * (error > 0.0 ? a_up : a_dn), -most_dn, most_up);
        p += step;
        if (moving && d * step <= restick) moving = 0;
        const double force = p - x;
        if (!moving && fabs(force) > fs) {
            moving = 1;
            d = force > 0.0 ? 1.0 : -1.0;
        }
        if (moving) x = p - d * fd;
        out[k] = q[8] * x + q[7];
    }
}
