/* The caller's arrays in SI units to rows in solver units, and back. */

/* Limits closer than this (solver units) are moved apart: the barrier needs an interior. */
static const double LEAST_ROOM = 2e-6;

static void set_bound(Workspace *s, int row, int k, double low, double high)
{
    if (high - low < LEAST_ROOM) {
        double middle = 0.5 * (low + high);
        low = middle - 0.5 * LEAST_ROOM;
        high = middle + 0.5 * LEAST_ROOM;
    }
    LANE(s->low[row], k) = low;
    LANE(s->high[row], k) = high;
}

/* No number lies between the limits, or one of them is NaN. */
INLINE int wrong(double low, double high)
{
    return !(low <= high && low < __builtin_inf() && high > -__builtin_inf());
}

static int load_bounds(Workspace *s, const Call *call)
{
    int bad = 0;
    for (int i = 0; i < NV; i++)
        for (int k = 0; k < LANES; k++) {
            LANE(s->low[i], k) = -__builtin_inf();
            LANE(s->high[i], k) = __builtin_inf();
        }
    for (int k = 0; k < N; k++)
        for (int i = 0; i < NU; i++) {
            double low = call->u_low[k * NU + i], high = call->u_high[k * NU + i];
            bad |= wrong(low, high);
            set_bound(s, i, k, low / SCALE_U[i], high / SCALE_U[i]);
        }
    for (int k = 1; k <= N; k++)
        for (int i = 0; i < NX; i++) {
            double low = call->x_low[k * NX + i], high = call->x_high[k * NX + i];
            bad |= wrong(low, high);
            set_bound(s, NU + i, k, low / SCALE_X[i], high / SCALE_X[i]);
        }
    for (int k = 0; k < N; k++)
        for (int i = 0; i < STAGE_NG; i++) {
            double low = call->g_low[k * STAGE_NG + i], high = call->g_high[k * STAGE_NG + i];
            bad |= wrong(low, high);
            set_bound(s, NW + i, k, low, high);
        }
    for (int i = 0; i < LAST_NG; i++) {
        bad |= wrong(call->h_low[i], call->h_high[i]);
        set_bound(s, NW + i, N, call->h_low[i], call->h_high[i]);
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

/* Set multipliers of absent bounds to 0: they are from a solve with other bounds. */
static void drop_unbounded(const Workspace *s, Point *at)
{
    for (int i = 0, b = 0; i < NV; i++) {
        if (b < s->n_bounded && s->bounded[b] == i) {
            b++;
            continue;
        }
        memset(at->z_low[i], 0, sizeof(Row));
        memset(at->z_high[i], 0, sizeof(Row));
    }
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
 * 0 when a number is not finite. */
static int load_multipliers(Workspace *s, const Call *call)
{
    Point *at = &s->at;
    double finite = 0;
    for (int k = 0; k < N; k++) {
        for (int i = 0; i < NX; i++)
            LANE(at->lam[i], k) = -call->m_dynamics[k * NX + i] * SCALE_X[i];
        for (int i = 0; i < NU; i++)
            LANE(at->z_high[i], k) = call->m_u[k * NU + i] * SCALE_U[i];
        for (int i = 0; i < STAGE_NG; i++)
            LANE(at->z_high[NW + i], k) = call->m_g[k * STAGE_NG + i];
    }
    for (int k = 1; k <= N; k++)
        for (int i = 0; i < NX; i++)
            LANE(at->z_high[NU + i], k) = call->m_x[k * NX + i] * SCALE_X[i];
    for (int i = 0; i < LAST_NG; i++)
        LANE(at->z_high[NW + i], N) = call->m_h[i];
    for (int i = 0; i < NV; i++)
        for (int j = 0; j < GROUPS; j++) {
            finite += sum(at->z_high[i][j] * 0.0);
            at->z_low[i][j] = -at->z_high[i][j];
        }
    for (int i = 0; i < NX; i++)
        for (int j = 0; j < GROUPS; j++)
            finite += sum(at->lam[i][j] * 0.0);
    drop_unbounded(s, at);
    memcpy(&s->next, at, sizeof *at);
    return finite == 0;
}

static void store(const Workspace *s, const Point *at, const Call *call)
{
    for (int k = 0; k <= N; k++)
        for (int i = 0; i < NX; i++) {
            call->X[k * NX + i] = LANE(at->v[NU + i], k) * SCALE_X[i];
            call->m_x[k * NX + i] =
                (LANE(at->z_high[NU + i], k) - LANE(at->z_low[NU + i], k)) / SCALE_X[i];
        }
    for (int k = 0; k < N; k++) {
        for (int i = 0; i < NU; i++) {
            call->U[k * NU + i] = LANE(at->v[i], k) * SCALE_U[i];
            call->m_u[k * NU + i] = (LANE(at->z_high[i], k) - LANE(at->z_low[i], k)) / SCALE_U[i];
        }
        for (int i = 0; i < NX; i++)
            call->m_dynamics[k * NX + i] = -LANE(at->lam[i], k) / SCALE_X[i];
        for (int i = 0; i < STAGE_NG; i++)
            call->m_g[k * STAGE_NG + i] =
                LANE(at->z_high[NW + i], k) - LANE(at->z_low[NW + i], k);
    }
    for (int i = 0; i < LAST_NG; i++)
        call->m_h[i] = LANE(at->z_high[NW + i], N) - LANE(at->z_low[NW + i], N);
}
