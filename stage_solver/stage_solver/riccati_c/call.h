/* The caller's arrays in SI units to rows in solver units, and back. */

/* Limits closer than this (solver units) are moved apart: the barrier needs an interior. */
static const double LEAST_ROOM = 2e-6;

/* The rows of v of a kind of limited quantity, and its stages [first, end). Row k of its arrays is
 * stage k, those of h are of the last stage alone. */
typedef struct {
    int row, columns, first, end, origin;
    const double *scale; /* SI units per solver unit; NULL: 1 */
} Kind;

static const Kind KIND[KINDS] = {
    {NU, NX, 1, N + 1, 0, SCALE_X},
    {0, NU, 0, N, 0, SCALE_U},
    {NW, STAGE_NG, 0, N, 0, NULL},
    {NW, LAST_NG, N, N + 1, N, NULL},
};

#define FOR_KINDS(kind) for (const Kind *kind = KIND; kind < KIND + KINDS; kind++)
/* every element of a kind from stage `first` on: lane k of row `row`, element `e` of its arrays */
#define FOR_ELEMENTS(kind, first, row, k, e)                                                       \
    for (int k = first; k < (kind)->end; k++)                                                      \
        for (int row = (kind)->row, e = (k - (kind)->origin) * (kind)->columns;                    \
             row < (kind)->row + (kind)->columns; row++, e++)

INLINE double scale_of(const Kind *kind, int row)
{
    return kind->scale ? kind->scale[row - kind->row] : 1.0;
}

static int load_bounds(Workspace *s, const Call *call)
{
    int bad = 0;
    for (int i = 0; i < NV; i++)
        for (int k = 0; k < LANES; k++) {
            LANE(s->low[i], k) = -__builtin_inf();
            LANE(s->high[i], k) = __builtin_inf();
        }
    FOR_KINDS(kind)
        FOR_ELEMENTS(kind, kind->first, row, k, e) {
            double low = call->low[kind - KIND][e], high = call->high[kind - KIND][e];
            /* no number lies between the limits, or one of them is NaN */
            bad |= !(low <= high && low < __builtin_inf() && high > -__builtin_inf());
            low /= scale_of(kind, row);
            high /= scale_of(kind, row);
            if (high - low < LEAST_ROOM) {
                double middle = 0.5 * (low + high);
                low = middle - 0.5 * LEAST_ROOM;
                high = middle + 0.5 * LEAST_ROOM;
            }
            LANE(s->low[row], k) = low;
            LANE(s->high[row], k) = high;
        }
    s->n_bounded = 0;
    for (int i = 0; i < NV; i++) {
        M any = {};
        for (int j = 0; j < GROUPS; j++) {
            M has = (s->low[i][j] > -__builtin_inf()) | (s->high[i][j] < __builtin_inf());
            any |= has;
            if (i >= NW)
                s->used[i - NW][j] = has;
        }
        if (v_any(any))
            s->bounded[s->n_bounded++] = i;
    }
    return !bad;
}

/* Fill a row from column `i` of a matrix, from lane `first` on; lanes past `rows` repeat the last
 * one: they are evaluated too and must not be special. Returns 0, or NaN for what is not finite. */
static double load_row(double *row, const double *matrix, int first, int rows, int columns, int i,
                       double scale)
{
    double finite = 0;
    for (int k = first; k < LANES; k++) {
        double value = matrix[(k < rows ? k : rows - 1) * columns + i] / scale;
        finite += value * 0.0;
        row[k] = value;
    }
    return finite;
}

/* Parameters, bounds and masks; 0 when a number is not finite or limits cross. */
static int load(Workspace *s, const Call *call)
{
    double finite = 0;
    /* rows and lanes without a bound or a stage are not written again */
    Row *rows[] = {s->sigma, s->push, s->dv, s->dz_low, s->dz_high};
    for (int i = 0; i < 5; i++)
        memset(rows[i], 0, NV * sizeof(Row));
    memset(s->lam_next, 0, sizeof s->lam_next);
    memset(&s->here, 0, sizeof s->here);
    memset(&s->trial, 0, sizeof s->trial);
    memset(s->live, 0, sizeof s->live);
    for (int k = 0; k < N; k++)
        MASK_LANE(s->live, k) = -1;
    for (int i = 0; i < NP; i++)
        finite += load_row(D(s->p[i]), call->P, 0, N + 1, NP, i, 1.0);
    return load_bounds(s, call) && finite == 0;
}

/* States and inputs of the guess; 0 when a number is not finite. */
static int load_guess(Workspace *s, const Call *call)
{
    Point *at = &s->at;
    double finite = 0;
    memset(at, 0, sizeof *at);
    for (int i = 0; i < NU; i++)
        finite += load_row(D(at->v[i]), call->U, 0, N, NU, i, SCALE_U[i]);
    for (int i = 0; i < NX; i++) {
        double *x = D(at->v[NU + i]);
        x[0] = call->x0[i] / SCALE_X[i];
        finite += x[0] * 0.0 + load_row(x, call->X, 1, N + 1, NX, i, SCALE_X[i]);
    }
    memcpy(&s->next, at, sizeof *at);
    return finite == 0;
}

/* Multipliers of the guess, those of bounds as +z and -z: set_multipliers keeps the positive one.
 * Those of absent bounds are 0: they are from a solve with other bounds. Returns 0 when a number
 * is not finite. */
static int load_multipliers(Workspace *s, const Call *call)
{
    Point *at = &s->at;
    double finite = 0;
    for (int k = 0; k < N; k++)
        for (int i = 0; i < NX; i++) {
            LANE(at->lam[i], k) = -call->m_dynamics[k * NX + i] * SCALE_X[i];
            finite += LANE(at->lam[i], k) * 0.0;
        }
    FOR_KINDS(kind)
        FOR_ELEMENTS(kind, kind->first, row, k, e) {
            double z = call->m[kind - KIND][e] * scale_of(kind, row);
            finite += z * 0.0;
            LANE(at->z_high[row], k) = z;
        }
    for (int i = 0, b = 0; i < NV; i++) {
        if (b < s->n_bounded && s->bounded[b] == i) {
            b++;
            for (int j = 0; j < GROUPS; j++)
                at->z_low[i][j] = -at->z_high[i][j];
        } else {
            memset(at->z_high[i], 0, sizeof(Row));
        }
    }
    memcpy(&s->next, at, sizeof *at);
    return finite == 0;
}

static void store(const Workspace *s, const Point *at, const Call *call)
{
    FOR_KINDS(kind)
        FOR_ELEMENTS(kind, kind->origin, row, k, e) {
            double scale = scale_of(kind, row);
            call->m[kind - KIND][e] = (LANE(at->z_high[row], k) - LANE(at->z_low[row], k)) / scale;
            if (row < NW)
                (row < NU ? call->U : call->X)[e] = LANE(at->v[row], k) * scale;
        }
    for (int k = 0; k < N; k++)
        for (int i = 0; i < NX; i++)
            call->m_dynamics[k * NX + i] = -LANE(at->lam[i], k) / SCALE_X[i];
}
