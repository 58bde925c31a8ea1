/* Globalisation: a filter line search (Fletcher & Leyffer 2002; Waechter & Biegler 2006). */

enum { FILTER = 64, HALVINGS = 14 };

typedef struct {
    double violation[FILTER], objective[FILTER];
    int n;
    double most, small; /* limits of the violation: never above, and where Armijo's rule applies */
} Filter;

static const double SUFFICIENT = 1e-5, ARMIJO = 1e-4, ROUND_OFF = 1e-13;

static void clear_filter(Filter *filter, double violation)
{
    filter->n = 0;
    filter->most = 1e4 * (violation > 1 ? violation : 1);
    filter->small = 1e-4 * (violation > 1 ? violation : 1);
}

static int filter_allows(const Filter *filter, double violation, double objective)
{
    if (!(violation <= filter->most))
        return 0;
    for (int i = 0; i < filter->n; i++)
        if (violation >= filter->violation[i] && objective >= filter->objective[i])
            return 0;
    return 1;
}

static void remember(Filter *filter, double violation, double objective)
{
    int n = 0;
    for (int i = 0; i < filter->n; i++) /* drop what the new entry dominates */
        if (filter->violation[i] < violation || filter->objective[i] < objective) {
            filter->violation[n] = filter->violation[i];
            filter->objective[n++] = filter->objective[i];
        }
    if (n == FILTER) { /* forget the oldest */
        for (int i = 1; i < n; i++) {
            filter->violation[i - 1] = filter->violation[i];
            filter->objective[i - 1] = filter->objective[i];
        }
        n--;
    }
    filter->violation[n] = violation;
    filter->objective[n] = objective;
    filter->n = n + 1;
}

/* The product of a multiplier and its distance stays within this factor of mu, as in Waechter &
 * Biegler's eq. 16, but closer: after a warm start on wrong bounds the products would grow without
 * end and spoil every later direction. */
static const double CENTRAL = 1e3;

INLINE V near(V z, V central) { return v_min(v_max(z, central / CENTRAL), central * CENTRAL); }

static void move(const Workspace *s, double primal, double dual, Point *to)
{
    const Point *from = &s->at;
    for (int i = 0; i < NV; i++)
        for (int j = 0; j < GROUPS; j++)
            to->v[i][j] = from->v[i][j] + primal * s->dv[i][j];
    for (int i = 0; i < NX; i++)
        for (int j = 0; j < GROUPS; j++)
            to->lam[i][j] = from->lam[i][j] + primal * (s->lam_next[i][j] - from->lam[i][j]);
    FOR_BOUNDED(s, i, j) {
        V low = s->mu / (to->v[i][j] - s->low[i][j]), high = s->mu / (s->high[i][j] - to->v[i][j]);
        to->z_low[i][j] = near(from->z_low[i][j] + dual * s->dz_low[i][j], low);
        to->z_high[i][j] = near(from->z_high[i][j] + dual * s->dz_high[i][j], high);
    }
}

/* Shorten the step until the filter accepts it; the accepted point is in s->next, its values in
 * s->trial. Returns the accepted step length, 0 when there is none.
 *
 * `restore`: only the violation has to decrease (the restoration of the filter). */
static double line_search(Workspace *s, Filter *filter, int restore)
{
    double violation = s->here.violation, objective = s->here.f - s->mu * s->here.log_sum;
    double round_off = ROUND_OFF * (1 + fabs(objective));
    double step = s->primal_step;
    for (int halved = 0; halved < HALVINGS; halved++, step *= 0.5) {
        move(s, step, s->dual_step, &s->next);
        evaluate_values(s, &s->next, &s->trial);
        double new_violation = s->trial.violation;
        double new_objective = s->trial.f - s->mu * s->trial.log_sum;
        if (!(fabs(new_objective) < __builtin_inf()))
            continue;
        if (restore) {
            if (new_violation <= (1 - ARMIJO * step) * violation) {
                clear_filter(filter, new_violation);
                return step;
            }
            continue;
        }
        if (!filter_allows(filter, new_violation, new_objective))
            continue;
        int descends = s->slope < 0 && violation <= filter->small &&
                       -s->slope * step > pow(violation, 1.1);
        if (descends) {
            if (new_objective <= objective + ARMIJO * step * s->slope + round_off)
                return step;
        } else if (new_violation <= (1 - SUFFICIENT) * violation ||
                   new_objective <= objective - SUFFICIENT * violation + round_off) {
            remember(filter, (1 - SUFFICIENT) * violation, objective - SUFFICIENT * violation);
            return step;
        }
    }
    return 0;
}
