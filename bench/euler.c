/* The rivals in C: explicit Euler of the same equations with the paper's fixed step. The state is
   p, y, v and the row of the table of phases in which the machine is. Every condition is a level,
   tested after each step; switches lie on whole steps. SI units, pressures are gauge.

   `euler` has a loop for each kind of row, so that a step pays only for what its row needs;
   `euler_one_loop` is one loop over all steps, as one would write it first. Both give the same
   motion but for rounding. */
#include <math.h>

enum row_name { CLOSED, LIFT, CATCH_UP, SLOT, OPEN, RETURN_HIGH, RETURN_LOW, ROWS };

/* From `low` to `high` in y the slot is s0 + s1*y, and the net force on the plunger
   area*p + force0 - ks*y - friction*v + flow*balance. */
struct row {
    double area, mass, displaced, s0, s1, force0, ks, flow, low, high;
};

struct design {
    double stiffness, pump_flow, drain, friction, orifice, stroke;
    struct row row[ROWS];
};

struct state {
    double p, y, v, peak;
    enum row_name row;
};

/* What a run hands back: p, y, v after every `every` steps; the instant of each opening and the
   highest pressure between it and the one before, as far as there is room; how many there were. */
struct result {
    double *samples, *openings, *peaks;
    long room, found;
};

static const double VACUUM = -101325.0;

static inline double larger(double a, double b)
{
    return a > b ? a : b;
}

static inline double flow_balance(const struct design *d, const struct row *r, int slotted,
                                  double p, double y, double v)
{
    double balance = d->pump_flow - r->displaced * v;
    if (slotted && p > d->drain)
        balance -= d->orifice * (r->s0 + r->s1 * y) * sqrt(p - d->drain);
    return balance;
}

static inline double net_force(const struct design *d, const struct row *r, double p, double y,
                               double v, double balance)
{
    return r->area * p + r->force0 - r->ks * y - d->friction * v + r->flow * balance;
}

static void note_opening(struct state *s, struct result *out, double time)
{
    if (out->found < out->room) {
        out->openings[out->found] = time;
        out->peaks[out->found] = s->peak;
    }
    out->found++;
    s->peak = 0.0;
}

/* Build-up and dwell, up to `left` steps: only the pressure moves, until the force has the sign
   that ends them. Returns how many steps remain. */
static inline long stand(const struct design *d, struct state *s, double dt, long left, int slotted)
{
    const struct row r = d->row[s->row];
    const double gain = dt * d->stiffness, sign = slotted ? -1.0 : 1.0, y = s->y;
    double p = s->p, peak = s->peak;
    while (left > 0) {
        double balance = flow_balance(d, &r, slotted, p, y, 0.0);
        double force = net_force(d, &r, p, y, 0.0, balance);
        p += gain * balance;
        if (slotted) /* a shut slot lets the pressure only rise */
            p = larger(p, VACUUM);
        peak = larger(peak, p);
        left--;
        if (sign * force > 0.0) {
            s->row = slotted ? RETURN_HIGH : LIFT;
            break;
        }
    }
    s->p = p, s->peak = peak;
    return left;
}

/* The row of a moving plunger after a step. */
static inline void leave(const struct design *d, struct state *s)
{
    const double gap = d->row[CATCH_UP].high;
    if (s->y >= d->stroke && s->v > 0.0)
        s->row = OPEN, s->y = d->stroke, s->v = 0.0;
    else if (s->y <= 0.0 && s->v < 0.0)
        s->row = CLOSED, s->y = 0.0, s->v = 0.0;
    else if (s->row >= OPEN || (s->y > gap && s->v < 0.0))
        s->row = s->y >= d->row[RETURN_HIGH].low ? RETURN_HIGH : RETURN_LOW;
    else
        s->row = s->y > gap ? SLOT : s->y > d->row[LIFT].high ? CATCH_UP : LIFT;
}

/* Forward and return stroke, up to `left` steps: until the plunger leaves the row or turns round
   in it. Returns how many steps remain. */
static inline long move(const struct design *d, struct state *s, double dt, long left, int slotted)
{
    const struct row r = d->row[s->row];
    const double gain = dt * d->stiffness, push = dt / r.mass;
    double p = s->p, y = s->y, v = s->v, peak = s->peak;
    while (left > 0) {
        double balance = flow_balance(d, &r, slotted, p, y, v), before = v;
        double force = net_force(d, &r, p, y, v, balance);
        p = larger(p + gain * balance, VACUUM);
        y += dt * v;
        v += push * force;
        peak = larger(peak, p);
        left--;
        if (y > r.high || y < r.low || (v < 0.0) != (before < 0.0))
            break;
    }
    s->p = p, s->y = y, s->v = v, s->peak = peak;
    leave(d, s);
    return left;
}

/* Run from rest for `steps` steps of `dt`. */
void euler(const struct design *d, double dt, long steps, long every, struct result *out)
{
    struct state s = {0.0, 0.0, 0.0, 0.0, CLOSED};
    double *sample = out->samples;
    for (long n = every; n <= steps; n += every) {
        for (long left = every; left > 0;) {
            switch (s.row) {
            case CLOSED:
                left = stand(d, &s, dt, left, 0);
                if (s.row != CLOSED)
                    note_opening(&s, out, (n - left) * dt);
                break;
            case OPEN:
                left = stand(d, &s, dt, left, 1);
                break;
            case LIFT:
            case CATCH_UP:
                left = move(d, &s, dt, left, 0);
                break;
            default:
                left = move(d, &s, dt, left, 1);
            }
        }
        *sample++ = s.p, *sample++ = s.y, *sample++ = s.v;
    }
}

/* The same, one step after another. */
void euler_one_loop(const struct design *d, double dt, long steps, long every, struct result *out)
{
    struct state s = {0.0, 0.0, 0.0, 0.0, CLOSED};
    double *sample = out->samples;
    for (long n = 1; n <= steps; n++) {
        const struct row *r = &d->row[s.row];
        int slotted = r->s0 != 0.0 || r->s1 != 0.0;
        double balance = flow_balance(d, r, slotted, s.p, s.y, s.v);
        double force = net_force(d, r, s.p, s.y, s.v, balance);
        s.p = larger(s.p + dt * d->stiffness * balance, VACUUM);
        s.peak = larger(s.peak, s.p);
        if (s.row == CLOSED) {
            if (force > 0.0) {
                s.row = LIFT;
                note_opening(&s, out, n * dt);
            }
        } else if (s.row == OPEN) {
            if (force < 0.0)
                s.row = RETURN_HIGH;
        } else {
            s.y += dt * s.v;
            s.v += dt * force / r->mass;
            leave(d, &s);
        }
        if (n % every == 0)
            *sample++ = s.p, *sample++ = s.y, *sample++ = s.v;
    }
}
