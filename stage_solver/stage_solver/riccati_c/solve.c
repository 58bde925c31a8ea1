/* A primal-dual interior-point method for stage-wise problems: one call is one solve.
 *
 * The algorithm, its equations and its sources: docs/solver.md. Nothing is allocated, no state is
 * kept between calls, and no path depends on anything but the arguments (the time limit apart):
 * equal calls give equal bits.
 */

/* ONE_STEP: the (nearly) full first step of a warm start satisfies the limits of the caller (real-time
 * iteration). A fresh start follows a SETBACK; after the second one the solve ends, INFEASIBLE when the
 * constraints are far from satisfied, with BAD_DERIVATIVES when a derivative at the last iterate is not
 * finite, as STUCK when no step was ever taken and the slope of the Lagrangian is far from zero. */
enum {
    SOLVED, ITERATION_LIMIT, TIME_LIMIT, STALLED, SETBACK, INFEASIBLE, NOT_FINITE, BAD_INPUT, ONE_STEP,
    BAD_DERIVATIVES, STUCK
};
static const double FAR = 1e-3; /* solver units */
static const double STEEP = 1e-2; /* slope of the Lagrangian per solver unit, as a share of the cost */

static const double COLD_MU = 0.1, COLD_MARGIN = 1e-2, WARM_MARGIN = 1e-3;
static const double FIRST_DELTA = 1e-4, MOST_DELTA = 1e10, RESTORING_DELTA = 1e5;
/* A warm start with the wrong active bounds cannot move: after so many steps in a row shorter than
 * this a cold start follows. */
static const double SHORT_STEP = 0.1;
enum { SHORT_STEPS = 2, STALLED_STEPS = 3 };
/* After so many steps without a lower violation, while it is far from zero, and without a cost that
 * is lower by this share, there is no feasible point near. */
enum { PATIENCE = 30 };
static const double WORTHWHILE = 0.01;

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Factorise with the least delta that is enough, `delta` or more (Waechter & Biegler 2006,
 * algorithm IC); 0 when there is none. */
static int regularise(Workspace *s, double delta)
{
    while (delta <= MOST_DELTA) {
        if (factorise(s, delta)) {
            s->delta = delta;
            if (delta > 0)
                s->delta_last = delta;
            return 1;
        }
        if (delta == 0)
            delta = fmax(FIRST_DELTA, s->delta_last / 3);
        else
            delta *= s->delta_last > 0 ? 8 : 100;
    }
    return 0;
}

/* First iterate: inside the bounds, slacks equal to g, matching multipliers. */
static void start(Workspace *s, double mu, double margin)
{
    s->mu = s->n_bounded ? mu : 0;
    s->delta = s->delta_last = 0;
    push_inside(s, &s->at, 0, NW, margin);
    evaluate_functions(s, &s->at, &s->here);
    memcpy(s->at.v + NW, s->here.g, sizeof s->here.g);
    push_inside(s, &s->at, NW, NV, margin);
    measure(s, &s->at, &s->here);
    set_multipliers(s, &s->at);
}

static void keep_best(Workspace *s, double feasible)
{
    double score = s->here.largest <= feasible ? 0 : s->here.largest;
    if (score < s->best_violation || (score == s->best_violation && s->here.f < s->best_f)) {
        s->best_violation = score;
        s->best_f = s->here.f;
        memcpy(&s->best, &s->at, sizeof s->at);
    }
}

/* Step to s->next; returns its length, 0 when no direction is acceptable. First the direction of
 * Newton's method; then, with more and more delta, the shortest one that leads to feasibility. */
static double find_step(Workspace *s, Filter *filter)
{
    double delta = 0;
    for (int attempt = 0; attempt < 3; attempt++) {
        if (!regularise(s, delta))
            return 0;
        roll_forward(s);
        complete_step(s);
        double step = line_search(s, filter, attempt == 2);
        if (step > 0)
            return step;
        delta = attempt == 0 ? fmax(1.0, 10 * s->delta) : RESTORING_DELTA;
    }
    return 0;
}

static int iterate(Workspace *s, Call *call, int warm, double deadline)
{
    const double tolerance = call->tolerance, feasible = 10 * tolerance;
    const double mu_last = 0.1 * tolerance;
    double least = s->here.violation, cheapest = s->here.f;
    int stalled = 0, shortened = 0, fruitless = 0;
    Filter filter;
    clear_filter(&filter, s->here.violation);
    for (;;) {
        if (!(fabs(s->here.f) < __builtin_inf()) || !(s->here.violation < __builtin_inf()))
            /* where an earlier attempt had values, the guess has them: a fresh start has none */
            return s->best_violation < __builtin_inf() ? SETBACK : NOT_FINITE;
        keep_best(s, feasible);
        if (call->iterations >= call->max_iterations)
            return ITERATION_LIMIT;
        if (now() > deadline)
            return TIME_LIMIT;
        call->iterations++;

        barrier_terms(s);
        evaluate_quadratic(s, &s->at);
        double step = find_step(s, &filter);
        if (step == 0)
            return SETBACK;
        s->accepted++;
        double size = fmax(1, fabs(s->here.f)), change = fabs(s->trial.f - s->here.f);
        int nearly_feasible = s->here.largest <= 100 * tolerance;
        int converged = step > 0.9 && nearly_feasible && s->decrement <= tolerance * size;
        int centred = step > 0.5 && s->here.largest <= 1e-3 && s->decrement <= 10 * s->mu;
        memcpy(&s->at, &s->next, sizeof s->at);
        memcpy(&s->here, &s->trial, sizeof s->here);

        if (s->mu <= mu_last && converged && s->here.largest <= feasible &&
            largest_complementarity(s, &s->at) <= 10 * s->mu + 0.1 * tolerance * size)
            return SOLVED;
        if (warm && step > 0.9 && s->here.largest <= call->step_residual &&
            s->decrement <= call->step_decrease * size)
            return ONE_STEP;
        shortened = s->primal_step < SHORT_STEP ? shortened + 1 : 0;
        if (warm && shortened == SHORT_STEPS)
            return SETBACK;
        if (s->here.largest <= FAR || s->here.violation < 0.99 * least) {
            least = s->here.violation;
            fruitless = 0;
        } else if (s->here.f < cheapest - WORTHWHILE * fmax(1, fabs(cheapest))) {
            fruitless = 0;
        } else if (++fruitless == PATIENCE) {
            return SETBACK;
        }
        cheapest = fmin(cheapest, s->here.f);
        /* second derivatives jump, and Newton's method may cycle around a jump */
        int still = change <= tolerance * size && s->here.largest <= feasible;
        stalled = still ? stalled + 1 : 0;
        if (stalled == STALLED_STEPS && s->mu <= mu_last)
            return STALLED;
        if ((centred || stalled == STALLED_STEPS) && s->mu > mu_last) {
            s->mu = fmax(mu_last, s->mu * fmin(0.2, sqrt(s->mu)));
            clear_filter(&filter, s->here.violation);
            stalled = 0;
        }
    }
}

size_t riccati_bytes(void) { return sizeof(Workspace); }
size_t riccati_call_bytes(void) { return sizeof(Call); }

void riccati_solve(Workspace *s, Call *call)
{
    double deadline = now() + call->time_limit;
    call->iterations = 0;
    call->cost = __builtin_nan("");
    call->primal_residual = call->dual_residual = __builtin_inf();
    call->status = BAD_INPUT;
    if (!load(s, call) || !load_guess(s, call))
        return;
    int warm = call->warm && load_multipliers(s, call);
    evaluate_once(s);
    s->best_violation = s->best_f = __builtin_inf();
    s->accepted = 0;
    call->stage = -1;
    if (warm) {
        start(s, call->warm_mu, WARM_MARGIN);
        call->status = iterate(s, call, 1, deadline);
    }
    for (int attempt = 0; attempt < 2; attempt++) {
        if (call->status != SETBACK && (warm || attempt > 0))
            break;
        load_guess(s, call);
        if (attempt > 0) { /* without defects, but possibly far from the guess */
            push_inside(s, &s->at, 0, NU, COLD_MARGIN);
            simulate(s, &s->at);
        }
        start(s, COLD_MU, COLD_MARGIN);
        call->status = iterate(s, call, 0, deadline);
    }
    /* before `best` replaces the iterate at which the derivatives were evaluated */
    if (call->status == SETBACK && find_bad_derivative(s, call))
        call->status = BAD_DERIVATIVES;
    if (call->status != SOLVED && call->status != ONE_STEP && s->best_violation < __builtin_inf()) {
        memcpy(&s->at, &s->best, sizeof s->at);
        evaluate_values(s, &s->at, &s->here);
    }
    if (call->status == NOT_FINITE)
        return;
    if (call->status == SETBACK && s->here.largest > FAR)
        call->status = INFEASIBLE;
    call->cost = s->here.f;
    call->primal_residual = s->here.largest;
    call->dual_residual = dual_residual(s, &s->at);
    /* NaN is not flat either */
    int flat = call->dual_residual <= STEEP * fmax(1, fabs(call->cost));
    if (call->status == SETBACK && s->accepted == 0 && !flat)
        call->status = STUCK;
    store(s, &s->at, call);
}
