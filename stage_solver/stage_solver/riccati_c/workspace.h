/* The memory of a solve. Row i of an array is one quantity, lane k of the row is stage k.
 *
 * Generated before this file: the sizes N, NX, NU, NP, STAGE_NG, LAST_NG, NG (the larger of the
 * two), STAGE_ONCE, LAST_ONCE, and rows, columns and number of the non-zeros of H, JF and Jg.
 */
#define NW (NU + NX)         /* w = [u; x] */
#define NV (NW + NG)         /* v = [w; s], s the slacks of g */
#define GROUPS ((N + W) / W) /* vectors that hold N + 1 lanes */
#define LANES (GROUPS * W)
/* vectors that hold a row of the tableau [M | right-hand side], a state, an input */
#define TABLEAU ((NW + W) / W)
#define STATE ((NX + W - 1) / W)
#define INPUT ((NU + W - 1) / W)

typedef V Row[GROUPS];

/* The iterate: primal and dual variables. */
typedef struct {
    Row v[NV];
    Row z_low[NV], z_high[NV]; /* multipliers of the bounds, >= 0 */
    Row lam[NX];               /* lane k: of F(w_k) - x_{k+1} = 0 */
} Point;

/* The functions at a point, and the measures of the line search. */
typedef struct {
    Row F[NX], cost[1], g[NG];
    Row c[NX];  /* F(w_k) - x_{k+1} */
    Row cg[NG]; /* g - s where it has a bound */
    double f, log_sum, violation, largest;
} Values;

enum { KINDS = 4 }; /* of limited quantities: x, u, g, and h of the last stage */

/* Caller's data, SI units, row k = stage k. */
typedef struct {
    const double *x0, *P;
    const double *low[KINDS], *high[KINDS];
    double *X, *U;                 /* guess, then result */
    double *m[KINDS], *m_dynamics; /* their multipliers, likewise */
    double tolerance, time_limit, warm_mu;
    double step_residual, step_decrease; /* when one step is enough (ONE_STEP); < 0: never */
    double cost, primal_residual, dual_residual; /* result */
    long long warm, max_iterations;
    long long status, iterations; /* result */
    long long stage, part; /* of the first derivative that is not finite, with BAD_DERIVATIVES */
} Call;

typedef struct {
    Point at, next, best;
    Values here, trial;
    double best_violation, best_f;

    Row p[NP], once[STAGE_ONCE + 1];
    V last_p[NP], last_once[LAST_ONCE + 1];
    Row low[NV], high[NV];
    int bounded[NV], n_bounded; /* rows that have a bound in any lane */
    M live[GROUPS];             /* lanes of the stages before the last */
    M used[NG + 1][GROUPS];     /* where a row of g has a bound */

    /* the quadratic programme */
    Row inv_low[NV], inv_high[NV], sigma[NV], push[NV];
    Row y[NG + 1];
    Row q[NW], H[STAGE_H_NZ + 1], JF[STAGE_JF_NZ + 1], JG[STAGE_Jg_NZ + 1];
    V last_H[LAST_H_NZ + 1], last_JG[LAST_Jg_NZ + 1];

    /* its solution */
    V gain[N][NX + 1][INPUT];      /* du = -(gain[NX] + sum_j gain[j] dx_j) */
    V value[N + 1][NX + 1][STATE]; /* lam = value[NX] + sum_j value[j] dx_j */
    Row dv[NV], dz_low[NV], dz_high[NV], lam_next[NX];
    double slope, decrement, primal_step, dual_step;

    double mu, delta, delta_last;
    long long accepted; /* steps of this solve */
} Workspace;

#define LANE(row, k) (((double *)(row))[k])
#define MASK_LANE(row, k) (((long long *)(row))[k])

INLINE double sum(V x)
{
    double total = 0;
    for (int i = 0; i < W; i++)
        total += x[i];
    return total;
}

/* NaN when one lane is. */
INLINE double largest(V x)
{
    double most = x[0];
    for (int i = 1; i < W; i++)
        most = most != most || x[i] <= most ? most : x[i];
    return most;
}
