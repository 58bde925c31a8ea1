/* Queries of the path, of the road edges and of lines, in SI units; the Python functions named
   beside them say what each returns.

   Arrays are rows of one matrix, so that a table of n points with the columns X, Y, ... is
   table[0 .. n-1] = X, table[n .. 2 n-1] = Y and so on.

   Discs bound the blocks of BLOCK chords of a line: a search looks only into blocks that can hold
   the closest chord, so that its cost hardly depends on the length of the line. */
#include <math.h>

enum { BLOCK = 16 };
enum { NEAR = 16 };             /* of a guess: steps after which all are searched */
enum { PROJECTION_STEPS = 3 }; /* of Newton; each squares the error, below 1 m at first */
/* m of distance per m along the path, to choose between equally close points */
static const double S_PENALTY = 1e-3;
/* laps whose distances differ by less count as equally close: their chords do not coincide, m */
static const double LAP_TOLERANCE = 1.0;
static const double ROUNDING = 1e-6; /* m, more than that of a distance on any road */

static double square(double value) { return value * value; }

static double length(double dX, double dY) { return sqrt(dX * dX + dY * dY); }

/* The foot of a point on a chord. */
typedef struct {
  double free, share, square; /* share of the chord, the same clipped to it, m^2 to the foot */
} Foot;

static Foot foot_on_chord(const double *X, const double *Y, long i, double x, double y) {
  const double dX = X[i + 1] - X[i], dY = Y[i + 1] - Y[i], aX = x - X[i], aY = y - Y[i];
  Foot foot;
  foot.free = (aX * dX + aY * dY) / (dX * dX + dY * dY);
  foot.share = foot.free < 0 ? 0 : foot.free > 1 ? 1 : foot.free;
  foot.square = square(aX - foot.share * dX) + square(aY - foot.share * dY);
  return foot;
}

/* discs of a line ---------------------------------------------------------------------------- */

long disc_count(long chords) { return (chords + BLOCK - 1) / BLOCK; }

/* discs: rows X, Y, radius, one column per block of the chords between n points */
void make_discs(long n, const double *X, const double *Y, double *discs) {
  const long count = disc_count(n - 1);
  for (long block = 0; block < count; ++block) {
    const long first = block * BLOCK, last = first + BLOCK < n - 1 ? first + BLOCK : n - 1;
    const double x = (X[first] + X[last]) / 2, y = (Y[first] + Y[last]) / 2;
    double radius = 0;
    for (long i = first; i <= last; ++i) radius = fmax(radius, length(X[i] - x, Y[i] - y));
    discs[block] = x, discs[count + block] = y, discs[2 * count + block] = radius;
  }
}

/* Return an upper bound of the distance from a point to the closest chord. */
static double reach_to_nearest(long count, const double *discs, double x, double y) {
  double least = INFINITY;
  long nearest = 0;
  for (long b = 0; b < count; ++b) {
    const double away = square(discs[b] - x) + square(discs[count + b] - y);
    if (away < least) least = away, nearest = b;
  }
  return sqrt(least) + discs[2 * count + nearest];
}

/* the path ----------------------------------------------------------------------------------- */

/* Rows of a path of n arcs. */
typedef struct {
  long n;
  const double *X, *Y, *psi, *kappa, *theta, *v;
} Path;

static Path path_of(long n, const double *table) {
  return (Path){n, table, table + n, table + 2 * n, table + 3 * n, table + 4 * n, table + 5 * n};
}

/* Return the number of values <= t, or with `below` < t, in ascending order; n for NaN. */
static long count_up_to(const double *values, long n, double t, int below) {
  long low = 0, high = n;
  while (low < high) {
    const long middle = (low + high) / 2;
    if (below ? values[middle] >= t : values[middle] > t)
      high = middle;
    else
      low = middle + 1;
  }
  return low;
}

/* Return count_up_to(values, n, t, 0), which is likely near `guess`. */
static long count_near(const double *values, long n, double t, long guess) {
  for (int step = 0; step < NEAR && t == t; ++step)
    if (guess < n && values[guess] <= t)
      ++guess;
    else if (guess > 0 && values[guess - 1] > t)
      --guess;
    else
      return guess;
  return count_up_to(values, n, t, 0);
}

typedef struct {
  double X, Y, psi, kappa, v;
} Point;

/* reference_path.arcs_at for one theta; *arc: where the search begins, then its arc */
static Point path_point(const Path *path, double theta, long *arc) {
  const long i = *arc = count_near(path->theta + 1, path->n - 1, theta, *arc);
  const double d = theta - path->theta[i], half = path->kappa[i] * d / 2;
  const double chord = d * (1 - square(half) / 6), mean = path->psi[i] + half;
  return (Point){path->X[i] + chord * cos(mean), path->Y[i] + chord * sin(mean),
                 path->psi[i] + 2 * half, path->kappa[i], path->v[i]};
}

/* reference_path.arcs_at; out: rows X, Y, psi, kappa, v */
void path_at(long n, const double *table, long k, const double *theta, double *out) {
  const Path path = path_of(n, table);
  long arc = 0;
  for (long i = 0; i < k; ++i) {
    const Point point = path_point(&path, theta[i], &arc);
    out[i] = point.X, out[k + i] = point.Y, out[2 * k + i] = point.psi;
    out[3 * k + i] = point.kappa, out[4 * k + i] = point.v;
  }
}

/* ahead and left of a pose */
static void to_local(const Point *pose, double X, double Y, double *ahead, double *left) {
  const double c = cos(pose->psi), s = sin(pose->psi), dX = X - pose->X, dY = Y - pose->Y;
  *ahead = c * dX + s * dY;
  *left = c * dY - s * dX;
}

/* reference_path.project; with a `near` that is NaN the whole path is searched, and the closest
   chord of the first stretch of it about as close as any counts */
double path_project(long n, const double *table, double X, double Y, double near, double reach) {
  const Path path = path_of(n, table);
  long first = 1, last = n - 1;
  double least = INFINITY;
  if (near == near) {
    first = count_up_to(path.theta, n, near - reach, 1) - 1;
    first = first < 1 ? 1 : first > last - 1 ? last - 1 : first;
    const long end = count_up_to(path.theta, n, near + reach, 1) + 1;
    last = end < first + 1 ? first + 1 : end > last ? last : end;
  } else {
    for (long i = first; i < last; ++i)
      least = fmin(least, foot_on_chord(path.X, path.Y, i, X, Y).square);
    least = sqrt(least) + LAP_TOLERANCE;
  }
  long best = first;
  Foot nearest = foot_on_chord(path.X, path.Y, first, X, Y);
  int is_close = sqrt(nearest.square) <= least;
  for (long i = first + 1; i < last; ++i) {
    const Foot foot = foot_on_chord(path.X, path.Y, i, X, Y);
    if (sqrt(foot.square) > least) {
      if (is_close) break;
    } else {
      if (!is_close || foot.square < nearest.square) nearest = foot, best = i;
      is_close = 1;
    }
  }
  const double share = best == first || best == last - 1 ? nearest.free : nearest.share;
  double theta = path.theta[best] + share * (path.theta[best + 1] - path.theta[best]);
  for (int step = 0; step < PROJECTION_STEPS; ++step) {
    const Point pose = path_point(&path, theta, &best);
    double ahead, left;
    to_local(&pose, X, Y, &ahead, &left);
    const double shrink = 1 - pose.kappa * left;
    if (shrink <= 0) break; /* beyond the centre of the arc there is no foot */
    theta += ahead / shrink;
  }
  return theta;
}

/* path coordinates --------------------------------------------------------------------------- */

/* what a foot on a chord costs: its distance, and a little for being far from `near` */
static double node_cost(const Path *path, long i, double X, double Y, double near, Foot *foot) {
  const double *theta = path->theta + 1;
  *foot = foot_on_chord(path->X + 1, path->Y + 1, i, X, Y);
  const double here = theta[i] + foot->share * (theta[i + 1] - theta[i]);
  return sqrt(foot->square) + S_PENALTY * fabs(here - near);
}

/* the nearer end of the chord closest to a point: the chord decides, not its ends; *chord: where
   the search begins, then the closest one */
static double closest_node(const Path *path, const double *discs, double X, double Y, double near,
                           long *chord) {
  const long chords = path->n - 2, count = disc_count(chords); /* the first arc has no length */
  const double *theta = path->theta + 1;
  Foot foot;
  double best_cost = node_cost(path, *chord, X, Y, near, &foot) + ROUNDING;
  double result = theta[*chord + (foot.free > 0.5)];
  for (long b = 0; b < count; ++b) {
    const long first = b * BLOCK, last = first + BLOCK < chords ? first + BLOCK : chords;
    const double away = theta[first] > near  ? theta[first] - near
                        : theta[last] < near ? near - theta[last]
                                             : 0;
    const double reach = best_cost + ROUNDING + discs[2 * count + b] - S_PENALTY * away;
    if (reach < 0 || square(discs[b] - X) + square(discs[count + b] - Y) > square(reach)) continue;
    for (long i = first; i < last; ++i) {
      const double cost = node_cost(path, i, X, Y, near, &foot);
      if (cost < best_cost) best_cost = cost, result = theta[i + (foot.free > 0.5)], *chord = i;
    }
  }
  return result;
}

/* frenet_frame.refine; s: approximate values, replaced by the refined ones */
void path_refine(long n, const double *table, long k, const double *X, const double *Y, double *s,
                 double *e) {
  const Path path = path_of(n, table);
  long arc = 0;
  for (long i = 0; i < k; ++i) {
    double ahead, left;
    Point pose;
    for (int step = 0; step < PROJECTION_STEPS; ++step) {
      pose = path_point(&path, s[i], &arc);
      to_local(&pose, X[i], Y[i], &ahead, &left);
      if (pose.kappa * left < 1) {
        const double shrink = 1 - pose.kappa * left, turn = pose.kappa * ahead / shrink;
        s[i] += ahead / shrink * (1 - square(turn) / 3 + square(square(turn)) / 5);
      }
    }
    pose = path_point(&path, s[i], &arc);
    to_local(&pose, X[i], Y[i], &ahead, &left);
    e[i] = left;
  }
}

/* frenet_frame.to_frenet */
void path_to_frenet(long n, const double *table, const double *discs, long k, const double *X,
                    const double *Y, double near, double *s, double *e) {
  const Path path = path_of(n, table);
  long chord = 0;
  for (long i = 0; i < k; ++i) s[i] = closest_node(&path, discs, X[i], Y[i], near, &chord);
  path_refine(n, table, k, X, Y, s, e);
}

/* road edges --------------------------------------------------------------------------------- */

/* Rows of an edge of n points with its continuations. */
typedef struct {
  long n;
  const double *X, *Y, *s;
} Edge;

static Edge edge_of(long n, const double *table) {
  return (Edge){n, table, table + n, table + 2 * n};
}

/* The chord closest to a position, and the foot on it. */
typedef struct {
  Foot foot;
  long chord;
} Nearest;

/* Look into one block of chords; of equally close chords the first one counts. */
static void search_block(const Edge *edge, long block, double x, double y, Nearest *nearest) {
  const long chords = edge->n - 3, first = block * BLOCK;
  const long last = first + BLOCK < chords ? first + BLOCK : chords;
  for (long i = first; i < last; ++i) {
    const Foot foot = foot_on_chord(edge->X + 1, edge->Y + 1, i, x, y);
    const double gain = nearest->foot.square - foot.square;
    if (gain > 0 || (gain == 0 && i < nearest->chord)) nearest->foot = foot, nearest->chord = i;
  }
}

/* the length along the edge closest to one position; the blocks first .. last - 1 can hold the closest chord, and
   *block likely does: it is searched first, and set to the one that does */
static double edge_foot(const Edge *edge, const double *discs, long first, long last, long *block,
                        double x, double y) {
  const long chords = edge->n - 3, count = disc_count(chords);
  const double *s = edge->s + 1;
  Nearest nearest = {{NAN, NAN, INFINITY}, 0};
  search_block(edge, *block, x, y, &nearest);
  double reach = sqrt(nearest.foot.square) + ROUNDING;
  for (long b = first; b < last; ++b) {
    const double away = reach + discs[2 * count + b];
    if (square(discs[b] - x) + square(discs[count + b] - y) > square(away) || b == *block) continue;
    search_block(edge, b, x, y, &nearest);
    reach = sqrt(nearest.foot.square) + ROUNDING;
  }
  const long best = nearest.chord;
  const double share = nearest.foot.share;
  *block = best / BLOCK;
  const int outside = (best == 0 && share == 0) || (best == chords - 1 && share == 1);
  return s[best] + (outside ? nearest.foot.free : share) * (s[best + 1] - s[best]);
}

/* numpy.interp of X and Y over s, for s within the line */
static void edge_point(const Edge *edge, double s, double *X, double *Y) {
  long i = count_up_to(edge->s, edge->n, s, 0) - 1;
  i = i < 0 ? 0 : i > edge->n - 2 ? edge->n - 2 : i;
  const double length = edge->s[i + 1] - edge->s[i], along = s - edge->s[i];
  *X = (edge->X[i + 1] - edge->X[i]) / length * along + edge->X[i];
  *Y = (edge->Y[i + 1] - edge->Y[i]) / length * along + edge->Y[i];
}

/* road_edges.edge_beside: the parabola at the point of the edge closest to each position;
   out: rows X, Y, psi, kappa */
void edge_beside(long n, const double *table, const double *discs, long k, const double *X,
                 const double *Y, double window, double *out) {
  const Edge edge = edge_of(n, table);
  const long count = disc_count(n - 3);
  /* blocks that can be closest to one of the positions: from their centre, within a radius of it,
     the closest chord is at most twice that radius farther than the chord closest to the centre */
  double x = 0, y = 0, radius = 0;
  for (long i = 0; i < k; ++i) x += X[i] / k, y += Y[i] / k;
  for (long i = 0; i < k; ++i) radius = fmax(radius, length(X[i] - x, Y[i] - y));
  const double reach = reach_to_nearest(count, discs, x, y) + 2 * radius + ROUNDING;
  long first = count, last = 0;
  for (long b = 0; b < count; ++b)
    if (!(square(discs[b] - x) + square(discs[count + b] - y) >
          square(reach + discs[2 * count + b]))) {
      if (b < first) first = b;
      last = b + 1;
    }
  long block = first < last ? first : 0;
  for (long i = 0; i < k; ++i) {
    double s = edge_foot(&edge, discs, first, last, &block, X[i], Y[i]);
    const double low = edge.s[0] + window, high = edge.s[n - 1] - window;
    s = s < low ? low : s > high ? high : s;
    double bX, bY, hX, hY, aX, aY;
    edge_point(&edge, s - window, &bX, &bY);
    edge_point(&edge, s, &hX, &hY);
    edge_point(&edge, s + window, &aX, &aY);
    const double twice_area = (hX - bX) * (aY - hY) - (hY - bY) * (aX - hX);
    const double lengths =
        hypot(hX - bX, hY - bY) * hypot(aX - hX, aY - hY) * hypot(aX - bX, aY - bY);
    out[i] = hX, out[k + i] = hY, out[2 * k + i] = atan2(aY - bY, aX - bX);
    out[3 * k + i] = lengths > 0 ? 2 * twice_area / lengths : 0;
  }
}

/* lines -------------------------------------------------------------------------------------- */

/* compiled_queries.interpolate, row after row */
void interpolate(long rows, long k, const double *x, long n, const double *points,
                 const double *values, double *out) {
  for (; rows--; x += k, points += n, values += n, out += k)
    for (long i = 0, j = 0; i < k; ++i) {
      while (j < n - 1 && points[j + 1] <= x[i]) ++j;
      while (j > 0 && points[j] > x[i]) --j;
      const double along = x[i] - points[j];
      out[i] = values[j];
      if (j < n - 1 && along > 0)
        out[i] += (values[j + 1] - values[j]) / (points[j + 1] - points[j]) * along;
    }
}
