/* The quadratic programme
 *
 *   min  sum_k 1/2 d_k' (H_k + delta I) d_k + q_k' d_k   s.t.  dx_{k+1} = A_k dx_k + B_k du_k + c_k
 *
 * by the Riccati recursion, written as a partial elimination of the inputs from the tableau
 * [M | right-hand side] of every stage (Frison & Jorgensen 2013; fatrop: Vanroye et al. 2023).
 */

/* An input's pivot below this: the reduced Hessian is not positive definite. */
static const double LEAST_PIVOT = 1e-8;

typedef struct {
    V row[TABLEAU];
} Line;

#define AT(line, column) (((double *)(line).row)[column])

/* Sizes and patterns are known to the compiler: unrolled, every index is a constant. */
#define UNROLL _Pragma("GCC unroll 256")

INLINE void add_line(Line *to, double factor, const Line *from, int first)
{
    UNROLL
    for (int j = first; j < TABLEAU; j++)
        to->row[j] += factor * from->row[j];
}

static void keep_value(V value[NX + 1][STATE], double P[NX][NX], const double *p)
{
    UNROLL
    for (int i = 0; i < NX; i++) {
        UNROLL
        for (int j = 0; j < NX; j++)
            LANE(value[i], j) = P[i][j];
    }
    UNROLL
    for (int j = 0; j < NX; j++)
        LANE(value[NX], j) = p[j];
}

/* Entries of one stage; what is not in the patterns stays zero. */
typedef struct {
    Line AB[NX]; /* [B A c] */
    Line M[NW];  /* upper triangle and right-hand side */
} Tableau;

INLINE void load_stage(const Workspace *s, int k, double delta, Tableau *t)
{
    UNROLL
    for (int e = 0; e < STAGE_JF_NZ; e++)
        AT(t->AB[STAGE_JF_ROW[e]], STAGE_JF_COL[e]) = LANE(s->JF[e], k);
    UNROLL
    for (int i = 0; i < NX; i++)
        AT(t->AB[i], NW) = LANE(s->here.c[i], k);
    memset(t->M, 0, sizeof t->M);
    UNROLL
    for (int e = 0; e < STAGE_H_NZ; e++)
        AT(t->M[STAGE_H_ROW[e]], STAGE_H_COL[e]) = LANE(s->H[e], k);
    UNROLL
    for (int r = 0; r < NW; r++) {
        AT(t->M[r], r) += delta;
        AT(t->M[r], NW) = LANE(s->q[r], k);
    }
}

/* M += [B A]' P [B A],  right-hand side += [B A]' (P c + p) */
INLINE void add_cost_to_go(Tableau *t, double P[NX][NX], const double *p)
{
    Line PAB[NX];
    UNROLL
    for (int i = 0; i < NX; i++) {
        Line sum = {};
        UNROLL
        for (int j = 0; j < NX; j++)
            add_line(&sum, P[i][j], &t->AB[j], 0);
        sum.row[NW / W][NW % W] += p[i];
        PAB[i] = sum;
    }
    UNROLL
    for (int e = 0; e < STAGE_JF_NZ; e++) {
        int row = STAGE_JF_ROW[e], column = STAGE_JF_COL[e];
        add_line(&t->M[column], AT(t->AB[row], column), &PAB[row], column / W);
    }
}

/* Eliminate the inputs; K becomes the rows of the gain. 0 when a pivot is not positive (or NaN). */
INLINE int eliminate_inputs(Tableau *t, Line *K)
{
    UNROLL
    for (int i = 0; i < NU; i++) {
        double pivot = AT(t->M[i], i);
        if (!(pivot > LEAST_PIVOT))
            return 0;
        UNROLL
        for (int j = 0; j < TABLEAU; j++)
            K[i].row[j] = t->M[i].row[j] * (1.0 / pivot);
        UNROLL
        for (int r = i + 1; r < NW; r++)
            add_line(&t->M[r], -AT(t->M[i], r), &K[i], r / W);
    }
    UNROLL
    for (int i = NU - 2; i >= 0; i--)
        UNROLL
        for (int j = i + 1; j < NU; j++)
            add_line(&K[i], -AT(K[i], j), &K[j], 0);
    return 1;
}

/* Backward over the stages; 0 when the reduced Hessian is not positive definite. */
static int factorise(Workspace *s, double delta)
{
    double P[NX][NX] = {}, p[NX];
    UNROLL
    for (int e = 0; e < LAST_H_NZ; e++)
        P[LAST_H_ROW[e]][LAST_H_COL[e]] = P[LAST_H_COL[e]][LAST_H_ROW[e]] = s->last_H[e][0];
    UNROLL
    for (int i = 0; i < NX; i++) {
        P[i][i] += delta;
        p[i] = LANE(s->q[NU + i], N);
    }
    keep_value(s->value[N], P, p);

    /* Two tableaus, filled one stage ahead: the entries are stored one by one, and a vector load
     * of fresh scalar stores would have to wait for them. */
    Tableau tableaus[2] = {};
    load_stage(s, N - 1, delta, &tableaus[(N - 1) % 2]);
    for (int k = N - 1; k >= 0; k--) {
        Tableau *t = &tableaus[k % 2];
        Line K[NU];
        if (k > 0)
            load_stage(s, k - 1, delta, &tableaus[(k - 1) % 2]);
        add_cost_to_go(t, P, p);
        if (!eliminate_inputs(t, K))
            return 0;
        UNROLL
        for (int i = 0; i < NU; i++)
            UNROLL
            for (int j = 0; j <= NX; j++)
                LANE(s->gain[k][j], i) = AT(K[i], NU + j);
        UNROLL
        for (int i = 0; i < NX; i++) {
            UNROLL
            for (int j = i; j < NX; j++)
                P[i][j] = P[j][i] = AT(t->M[NU + i], NU + j);
            p[i] = AT(t->M[NU + i], NW);
        }
        keep_value(s->value[k], P, p);
    }
    return 1;
}

/* Roll the solution forward from dx_0 = 0: dv of the w rows, and the next lam. */
static void roll_forward(Workspace *s)
{
    double dx[NX] = {};
    for (int k = 0; k < N; k++) {
        V du[INPUT], lam[STATE];
        double d[NW], next[NX];
        for (int j = 0; j < INPUT; j++) {
            du[j] = -s->gain[k][NX][j];
            for (int i = 0; i < NX; i++)
                du[j] -= s->gain[k][i][j] * dx[i];
        }
        for (int i = 0; i < NW; i++) {
            d[i] = i < NU ? LANE(du, i) : dx[i - NU];
            LANE(s->dv[i], k) = d[i];
        }
        for (int i = 0; i < NX; i++)
            next[i] = LANE(s->here.c[i], k);
        UNROLL
        for (int e = 0; e < STAGE_JF_NZ; e++)
            next[STAGE_JF_ROW[e]] += LANE(s->JF[e], k) * d[STAGE_JF_COL[e]];
        for (int i = 0; i < NX; i++)
            dx[i] = next[i];
        for (int j = 0; j < STATE; j++) {
            lam[j] = s->value[k + 1][NX][j];
            for (int i = 0; i < NX; i++)
                lam[j] += s->value[k + 1][i][j] * dx[i];
        }
        for (int i = 0; i < NX; i++)
            LANE(s->lam_next[i], k) = LANE(lam, i);
    }
    for (int i = 0; i < NX; i++)
        LANE(s->dv[NU + i], N) = dx[i];

    /* the slacks follow: ds = Jg d + (g - s) */
    for (int j = 0; j < GROUPS; j++) {
        V ds[NG + 1];
        for (int i = 0; i < NG; i++)
            ds[i] = s->here.cg[i][j];
        UNROLL
        for (int e = 0; e < STAGE_Jg_NZ; e++)
            ds[STAGE_Jg_ROW[e]] += v_where(s->live[j], s->JG[e][j] * s->dv[STAGE_Jg_COL[e]][j]);
        for (int i = 0; i < NG; i++)
            s->dv[NW + i][j] = v_where(s->used[i][j], ds[i]);
    }
    for (int e = 0; e < LAST_Jg_NZ; e++)
        if (MASK_LANE(s->used[LAST_Jg_ROW[e]], N))
            LANE(s->dv[NW + LAST_Jg_ROW[e]], N) += s->last_JG[e][0] * dx[LAST_Jg_COL[e]];
}
