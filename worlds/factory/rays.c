/* What a spinning LiDAR's rays hit among upright boxes: the loops of worlds/factory/rays.py.

   All rays of a column have one azimuth, so a box's sides are met column by column, in the plan; a
   ray of the column meets them after the same way along the ground. Distances are such ways until
   the scan is complete. */

#include <math.h>
#include <stdint.h>

/* Raise with any change of what functions take: worlds/factory/rays.py has the same. */
int loops_version(void) { return 2; }

static const double TURN = 6.283185307179586;

static double lesser(double a, double b) { return a < b ? a : b; }
static double greater(double a, double b) { return a > b ? a : b; }

/* Lays the floor, `height` below the sensor, on all rays (columns, rings). `slope` is the tangent of
   each ring's elevation, ascending. */
void lay_floor(double height, const double *slope, long rings, long columns, float *way,
               int16_t *actor)
{
    for (long ring = 0; ring < rings; ring++)
        way[ring] = slope[ring] < 0.0 ? (float)(height / -slope[ring]) : INFINITY;
    for (long i = rings; i < rings * columns; i++) way[i] = way[i - rings];
    for (long i = 0; i < rings * columns; i++) actor[i] = -1;
}

/* The azimuths (low, high), with high - low <= a turn, in which a rectangle around (x, y) lies whose
   sides are turned by `cosine`, `sine`. The sensor, in the origin, is not in it. */
static void span(double x, double y, double half_x, double half_y, double cosine, double sine,
                 double *low, double *high)
{
    double middle = atan2(y, x), least = 0.0, most = 0.0;
    for (int corner = 0; corner < 4; corner++) {
        double along = corner & 1 ? half_x : -half_x, across = corner & 2 ? half_y : -half_y;
        double at_x = x + cosine * along - sine * across, at_y = y + sine * along + cosine * across;
        double turn = atan2(x * at_y - y * at_x, x * at_x + y * at_y);
        least = lesser(least, turn);
        most = greater(most, turn);
    }
    *low = middle + least;
    *high = middle + most;
}

/* Keeps what is nearer of what the rays (columns, rings) hit so far and of n boxes: `centers` and
   `halves` (n, 3) of their sides, `headings`, and the actor that each belongs to. `pose` is the
   sensor's x, y, z and yaw. Boxes of `own`, and those beyond `reach`, are not seen. `azimuth` is the
   cosine and sine (columns, 2) of the columns, which are evenly spaced from 0. */
void hit_boxes(const double *centers, const double *halves, const double *headings,
               const int16_t *owners, long n, int own, double reach, const double *pose,
               const double *slope, const float *flat, long rings, const double *azimuth,
               long columns, float *way, int16_t *actor)
{
    double step = TURN / columns;
    double cos_yaw = cos(pose[3]), sin_yaw = sin(pose[3]);
    for (long box = 0; box < n; box++) {
        const double *half = halves + 3 * box, *center = centers + 3 * box;
        double away_x = center[0] - pose[0], away_y = center[1] - pose[1];
        double x = cos_yaw * away_x + sin_yaw * away_y, y = cos_yaw * away_y - sin_yaw * away_x;
        if (owners[box] == own || hypot(x, y) - hypot(half[0], half[1]) >= reach) continue;
        double top = center[2] - pose[2] + half[2], bottom = center[2] - pose[2] - half[2];

        /* The box in its own frame, seen from the sensor. */
        double turn = headings[box] - pose[3], cosine = cos(turn), sine = sin(turn);
        double middle_x = cosine * x + sine * y, middle_y = cosine * y - sine * x;
        double gap_x = greater(fabs(middle_x) - half[0], 0.0);
        double gap_y = greater(fabs(middle_y) - half[1], 0.0);
        double near = sqrt(gap_x * gap_x + gap_y * gap_y);
        double far = hypot(fabs(middle_x) + half[0], fabs(middle_y) + half[1]);

        /* With some room: whether a ray hits is decided below. */
        double highest = 1e-6 + (top > 0.0 ? top / near : top / far);
        double lowest = -1e-6 + (bottom < 0.0 ? bottom / near : bottom / far);
        long first = 0, last = rings;
        while (first < rings && slope[first] < lowest) first++;
        while (last > first && slope[last - 1] > highest) last--;
        if (first == last) continue;
        long start = 0, count = columns;
        if (near > 0.0) {
            double low, high;
            span(x, y, half[0], half[1], cosine, sine, &low, &high);
            start = (long)floor(low / step - 1e-6);
            count = (long)ceil(high / step + 1e-6) - start + 1;
            if (count > columns) count = columns;
            start = (start + 2 * columns) % columns;
        }
        double low_x = middle_x - half[0], high_x = middle_x + half[0];
        double low_y = middle_y - half[1], high_y = middle_y + half[1];
        float up = (float)top, down = (float)bottom;
        int16_t owner = owners[box];
        for (long k = 0; k < count; k++) {
            long column = start + k < columns ? start + k : start + k - columns;
            /* Slab test (Kay and Kajiya, 1986): a ray is in the box while it is in all three
               slabs. */
            double to_x = cosine * azimuth[2 * column] + sine * azimuth[2 * column + 1];
            double to_y = cosine * azimuth[2 * column + 1] - sine * azimuth[2 * column];
            double per_x = 1.0 / (fabs(to_x) < 1e-12 ? 1e-12 : to_x);
            double per_y = 1.0 / (fabs(to_y) < 1e-12 ? 1e-12 : to_y);
            double one = low_x * per_x, other = high_x * per_x;
            double enter = lesser(one, other), leave = greater(one, other);
            one = low_y * per_y, other = high_y * per_y;
            enter = greater(enter, lesser(one, other));
            leave = lesser(leave, greater(one, other));
            if (enter > leave || leave <= 0.0) continue;
            float in = (float)enter, out = (float)leave;
            float *to = way + column * rings;
            int16_t *who = actor + column * rings;
            for (long ring = first; ring < last; ring++) {
                float at_top = up * flat[ring], at_bottom = down * flat[ring];
                float begin = at_top < at_bottom ? at_top : at_bottom;
                float end = at_top < at_bottom ? at_bottom : at_top;
                begin = begin > in ? begin : in;
                end = end < out ? end : out;
                int hit = (begin <= end) & (begin > 0.0f) & (begin < to[ring]);
                to[ring] = hit ? begin : to[ring];
                who[ring] = hit ? owner : who[ring];
            }
        }
    }
}

/* The ranges (rings, columns) at the ends of ways (columns, rings), and the actors there. A ray of
   each ring is `longer` than its way. */
void measure(const float *way, const int16_t *who, const float *longer, long rings, long columns,
             float *range, int16_t *actor)
{
    for (long ring = 0; ring < rings; ring++)
        for (long column = 0; column < columns; column++) {
            range[ring * columns + column] = way[column * rings + ring] * longer[ring];
            actor[ring * columns + column] = who[column * rings + ring];
        }
}

/* Of n rays, the points (m, 3) and actors of those that come back; returns m. Ranges err by `noise`
   times `deviation` and are multiples of `step`; a ray is lost when its `luck` is below `lost`, or its
   range not within `least` and `most`. There is room for n. */
long come_back(const float *range, const int16_t *actor, const float *rays, const float *noise,
               const float *luck, long n, float deviation, float step, float lost, float least,
               float most, float *points, int16_t *actors)
{
    long kept = 0;
    for (long i = 0; i < n; i++) {
        float error = noise[i] * deviation, distance = rintf((range[i] + error) / step) * step;
        points[3 * kept] = rays[3 * i] * distance;
        points[3 * kept + 1] = rays[3 * i + 1] * distance;
        points[3 * kept + 2] = rays[3 * i + 2] * distance;
        actors[kept] = actor[i];
        kept += (luck[i] >= lost) & (distance >= least) & (distance <= most);
    }
    return kept;
}
