/* The generated stage functions over all stages. */

/* Lane N of x rows, in every lane: the last stage has functions of its own. */
static void last_state(const Point *at, V *x)
{
    for (int i = 0; i < NX; i++)
        x[i] = v_all(LANE(at->v[NU + i], N));
}

#define D(pointer) ((double *)(pointer))

static void evaluate_once(Workspace *s)
{
    for (int j = 0; j < GROUPS; j++)
        stage_once(D(&s->p[0][j]), D(&s->once[0][j]));
    for (int i = 0; i < NP; i++)
        s->last_p[i] = v_all(LANE(s->p[i], N));
    last_once(D(s->last_p), D(s->last_once));
}

/* F, cost and g alone */
static void evaluate_functions(Workspace *s, const Point *at, Values *out)
{
    for (int j = 0; j < GROUPS; j++)
        stage_values(D(&s->p[0][j]), D(&s->once[0][j]), D(&at->v[0][j]), D(&out->F[0][j]),
                     D(&out->cost[0][j]), D(&out->g[0][j]));
    V x[NX], cost, g[LAST_NG + 1];
    last_state(at, x);
    last_values(D(s->last_p), D(s->last_once), D(x), NULL, D(&cost), D(g));
    LANE(out->cost[0], N) = cost[0];
    for (int i = 0; i < NG; i++)
        LANE(out->g[i], N) = i < LAST_NG ? g[i][0] : 0;
}

/* Simulate: replace the states by the response to the inputs. */
static void simulate(Workspace *s, Point *at)
{
    for (int k = 0; k < N; k++) {
        int j = k / W;
        stage_values(D(&s->p[0][j]), D(&s->once[0][j]), D(&at->v[0][j]), D(&s->trial.F[0][j]),
                     D(&s->trial.cost[0][j]), D(&s->trial.g[0][j]));
        for (int i = 0; i < NX; i++)
            LANE(at->v[NU + i], k + 1) = LANE(s->trial.F[i], k);
    }
}

/* Residuals and barrier of a point with evaluated functions. */
static void measure(const Workspace *s, const Point *at, Values *out)
{
    V f = {}, violation = {}, most = {};
    for (int j = 0; j < GROUPS; j++)
        f += v_where(s->live[j], out->cost[0][j]);
    out->f = sum(f) + LANE(out->cost[0], N);

    for (int i = 0; i < NX; i++) {
        double *F = D(out->F[i]), *c = D(out->c[i]);
        const double *x = D(at->v[NU + i]);
        for (int k = 0; k < N; k++)
            c[k] = F[k] - x[k + 1];
        for (int j = 0; j < GROUPS; j++) {
            V size = v_abs(out->c[i][j]);
            violation += size;
            most = v_select(size <= most, most, size); /* lets a NaN through */
        }
    }
    for (int i = 0; i < NG; i++)
        for (int j = 0; j < GROUPS; j++) {
            out->cg[i][j] = v_where(s->used[i][j], out->g[i][j] - at->v[NW + i][j]);
            V size = v_abs(out->cg[i][j]);
            violation += size;
            most = v_select(size <= most, most, size);
        }
    out->violation = sum(violation);
    out->largest = largest(most);

    /* the two distances of a variable are multiplied first: half as many logarithms */
    V logs = {};
    for (int b = 0; b < s->n_bounded; b++) {
        int i = s->bounded[b];
        for (int j = 0; j < GROUPS; j++) {
            V low = at->v[i][j] - s->low[i][j], high = s->high[i][j] - at->v[i][j];
            low = v_select(low < __builtin_inf(), low, v_all(1.0));
            high = v_select(high < __builtin_inf(), high, v_all(1.0));
            logs += v_log(low * high);
        }
    }
    out->log_sum = sum(logs);
}

static void evaluate_values(Workspace *s, const Point *at, Values *out)
{
    evaluate_functions(s, at, out);
    measure(s, at, out);
}

/* The quadratic programme at a point with evaluated barrier terms. */
static void evaluate_quadratic(Workspace *s, const Point *at)
{
    for (int i = 0; i < NG; i++)
        for (int j = 0; j < GROUPS; j++)
            s->y[i][j] = at->z_high[NW + i][j] - at->z_low[NW + i][j];
    for (int j = 0; j < GROUPS; j++)
        stage_quadratic(D(&s->p[0][j]), D(&s->once[0][j]), D(&at->v[0][j]), D(&at->lam[0][j]),
                        D(&s->y[0][j]), D(&s->sigma[0][j]), D(&s->push[0][j]), D(&s->q[0][j]),
                        D(&s->H[0][j]), D(&s->JF[0][j]), D(&s->JG[0][j]));

    V x[NX], y[LAST_NG + 1], sigma[NX + LAST_NG], push[NX + LAST_NG], q[NX];
    last_state(at, x);
    for (int i = 0; i < NX; i++) {
        sigma[i] = v_all(LANE(s->sigma[NU + i], N));
        push[i] = v_all(LANE(s->push[NU + i], N));
    }
    for (int i = 0; i < LAST_NG; i++) {
        y[i] = v_all(LANE(s->y[i], N));
        sigma[NX + i] = v_all(LANE(s->sigma[NW + i], N));
        push[NX + i] = v_all(LANE(s->push[NW + i], N));
    }
    last_quadratic(D(s->last_p), D(s->last_once), D(x), NULL, D(y), D(sigma), D(push), D(q),
                   D(s->last_H), NULL, D(s->last_JG));
    for (int i = 0; i < NW; i++)
        LANE(s->q[i], N) = i < NU ? 0 : q[i - NU][0];
}

/* Largest slope of the Lagrangian at a point. */
static double dual_residual(Workspace *s, const Point *at)
{
    Row slope[NW];
    V most = {};
    for (int i = 0; i < NG; i++)
        for (int j = 0; j < GROUPS; j++)
            s->y[i][j] = at->z_high[NW + i][j] - at->z_low[NW + i][j];
    for (int j = 0; j < GROUPS; j++)
        stage_slope(D(&s->p[0][j]), D(&s->once[0][j]), D(&at->v[0][j]), D(&at->lam[0][j]),
                    D(&s->y[0][j]), D(&slope[0][j]));
    V x[NX], y[LAST_NG + 1], last[NX];
    last_state(at, x);
    for (int i = 0; i < LAST_NG; i++)
        y[i] = v_all(LANE(s->y[i], N));
    last_slope(D(s->last_p), D(s->last_once), D(x), NULL, D(y), D(last));
    for (int i = 0; i < NX; i++) {
        LANE(slope[NU + i], N) = last[i][0];
        for (int k = 1; k <= N; k++)
            LANE(slope[NU + i], k) -= LANE(at->lam[i], k - 1);
        LANE(slope[NU + i], 0) = 0; /* the first state is fixed */
    }
    for (int i = 0; i < NW; i++)
        for (int j = 0; j < GROUPS; j++) {
            V size = v_abs(slope[i][j] + at->z_high[i][j] - at->z_low[i][j]);
            for (int lane = 0; lane < W; lane++)
                if (j * W + lane > N || (i < NU && j * W + lane == N))
                    size[lane] = 0;
            most = v_select(size <= most, most, size);
        }
    return largest(most);
}

/* The functions whose derivatives are not finite; the cost is asked last, since the gradient q and the
 * Hessian of the Lagrangian H contain what the others spoil. */
enum { DYNAMICS, CONSTRAINTS, COST };

INLINE int is_bad(double x) { return !(fabs(x) < __builtin_inf()); }

/* Whether a derivative of the quadratic programme evaluated last is not finite; the first one goes to
 * `call`. The state of stage 0 is fixed: its own slope and curvature have no effect. */
static int find_bad_derivative(const Workspace *s, Call *call)
{
    for (int k = 0; k <= N; k++) {
        int cost = 0, constraints = 0, dynamics = 0;
        for (int i = 0; i < NW; i++)
            cost |= (k > 0 || i < NU) && is_bad(LANE(s->q[i], k));
        if (k < N) {
            for (int e = 0; e < STAGE_H_NZ; e++)
                cost |= is_bad(LANE(s->H[e], k)) &&
                        (k > 0 || STAGE_H_ROW[e] < NU || STAGE_H_COL[e] < NU);
            for (int e = 0; e < STAGE_Jg_NZ; e++)
                constraints |= (k > 0 || STAGE_Jg_COL[e] < NU) && is_bad(LANE(s->JG[e], k));
            for (int e = 0; e < STAGE_JF_NZ; e++)
                dynamics |= is_bad(LANE(s->JF[e], k));
        } else {
            for (int e = 0; e < LAST_H_NZ; e++)
                cost |= is_bad(s->last_H[e][0]);
            for (int e = 0; e < LAST_Jg_NZ; e++)
                constraints |= is_bad(s->last_JG[e][0]);
        }
        int part = dynamics ? DYNAMICS : constraints ? CONSTRAINTS : cost ? COST : -1;
        if (part >= 0) {
            call->stage = k;
            call->part = part;
            return 1;
        }
    }
    return 0;
}
