/* Bounds on inputs, states and slacks: logarithmic barrier and its primal-dual step.
 *
 * An absent bound is infinite and its multiplier 0; 1/inf = 0 then removes it from every formula.
 */

#define FOR_BOUNDED(s, i, j)                                                                       \
    for (int b_ = 0, i; b_ < (s)->n_bounded && (i = (s)->bounded[b_], 1); b_++)                    \
        for (int j = 0; j < GROUPS; j++)

/* Curvature sigma and gradient of the barrier in v; for slacks `push` is the factor of Jg'. */
static void barrier_terms(Workspace *s)
{
    FOR_BOUNDED(s, i, j) {
        V low = 1.0 / (s->at.v[i][j] - s->low[i][j]), high = 1.0 / (s->high[i][j] - s->at.v[i][j]);
        s->inv_low[i][j] = low;
        s->inv_high[i][j] = high;
        V sigma = s->at.z_low[i][j] * low + s->at.z_high[i][j] * high;
        s->sigma[i][j] = sigma;
        s->push[i][j] = s->mu * (high - low);
        if (i >= NW)
            s->push[i][j] += sigma * s->here.cg[i - NW][j];
    }
}

/* Multiplier steps, the largest steps to the boundary, and the directional derivative of the
 * barrier function along dv. */
static void complete_step(Workspace *s)
{
    V primal = {}, dual = {}, slope = {};
    FOR_BOUNDED(s, i, j) {
        V d = s->dv[i][j], low = s->inv_low[i][j], high = s->inv_high[i][j];
        V z_low = s->at.z_low[i][j], z_high = s->at.z_high[i][j];
        V to_low = -d * low, to_high = d * high; /* share of the distance to the bound in a full step */
        V dz_low = s->mu * low - z_low + z_low * to_low;
        V dz_high = s->mu * high - z_high + z_high * to_high;
        s->dz_low[i][j] = dz_low;
        s->dz_high[i][j] = dz_high;
        primal = v_max(primal, v_max(to_low, to_high));
        V least_low = v_where(z_low > 0.0, -dz_low / z_low);
        V least_high = v_where(z_high > 0.0, -dz_high / z_high);
        dual = v_max(dual, v_max(least_low, least_high));
        if (i >= NW) {
            V barrier = s->mu * (high - low), cg = s->here.cg[i - NW][j];
            slope += barrier * d - s->push[i][j] * (d - cg);
        }
    }
    double along = 0, multiplied = 0;
    for (int i = 0; i < NW; i++) {
        V total = {};
        for (int j = 0; j < GROUPS; j++)
            total += v_where(s->dv[i][j] != 0.0, s->q[i][j] * s->dv[i][j]);
        along += sum(total);
    }
    for (int i = 0; i < NX; i++) {
        V total = {};
        for (int j = 0; j < GROUPS; j++)
            total += s->lam_next[i][j] * s->here.c[i][j];
        multiplied += sum(total);
    }
    /* d'(H + delta I) d = lam'c - q'd: twice the decrease that the quadratic programme predicts */
    s->decrement = multiplied - along;
    s->slope = along + sum(slope);
    double keep = s->mu < 0.01 ? 1 - s->mu : 0.99;
    s->primal_step = largest(primal) > keep ? keep / largest(primal) : 1;
    s->dual_step = largest(dual) > keep ? keep / largest(dual) : 1;
}

/* Largest product of a multiplier and its distance: mu at the solution. */
static double largest_complementarity(const Workspace *s, const Point *at)
{
    V most = {};
    FOR_BOUNDED(s, i, j) {
        most = v_max(most, v_where(s->low[i][j] > -__builtin_inf(),
                                   at->z_low[i][j] * (at->v[i][j] - s->low[i][j])));
        most = v_max(most, v_where(s->high[i][j] < __builtin_inf(),
                                   at->z_high[i][j] * (s->high[i][j] - at->v[i][j])));
    }
    return largest(most);
}

/* Move every bounded variable of rows [from, to) inside its bounds by `margin` at least. */
static void push_inside(Workspace *s, Point *at, int from, int to, double margin)
{
    FOR_BOUNDED(s, i, j) {
        if (i < from || i >= to)
            continue;
        V room = v_min(v_all(margin), 0.25 * (s->high[i][j] - s->low[i][j]));
        V v = v_max(at->v[i][j], s->low[i][j] + room);
        at->v[i][j] = v_min(v, s->high[i][j] - room);
    }
}

/* Multipliers that match the distances; `at` may contain the net multipliers of a warm start. */
static void set_multipliers(Workspace *s, Point *at)
{
    FOR_BOUNDED(s, i, j) {
        V least_low = s->mu / (at->v[i][j] - s->low[i][j]);
        V least_high = s->mu / (s->high[i][j] - at->v[i][j]);
        at->z_low[i][j] =
            v_max(v_where(s->low[i][j] > -__builtin_inf(), at->z_low[i][j]), least_low);
        at->z_high[i][j] =
            v_max(v_where(s->high[i][j] < __builtin_inf(), at->z_high[i][j]), least_high);
    }
}
