/* What stands around a robot, and how well it lies over what the ego sees: the loops of
   perception/scene/fast.py and visibility.py, and of perception/fusion/outline.py and
   alignment.py. */

#include <math.h>
#include <stdint.h>
#include <string.h>

/* Raise with any change of what functions take: perception/kernels/library.py has the same. */
int loops_version(void) { return 3; }

static float least(float a, float b) { return a < b ? a : b; }

/* Each cell (n) of a row or column bounded by those at both sides of it plus `rise`. */
static void bound(const float *before, const float *here, const float *after, float rise, long n,
                  float *restrict bounded)
{
    for (long i = 0; i < n; i++)
        bounded[i] = least(here[i], least(before[i] + rise, after[i] + rise));
}

/* The columns of a wide grid that lie between its borders. */
static float *row_of(float *grid, long wide, long border, long row)
{
    return grid + (row + border) * wide + border;
}

/* Height of points (n, 3) above the ground below them: see `_ground_height` of
   perception/scene/fast.py. Cells are 1 / `per_m` metres; `side` of them lie along each axis, from
   -range_m on. The steps of the bound, `count`, are told by cells and by rise. Scratch: `cells`
   (n), `grids` 2 (side + 2 border)^2, with a border as wide as the largest step. */
void heights_above(const float *points, long n, float range_m, float per_m, long side, float pit_m,
                   const int64_t *steps, const float *rises, long count, long border,
                   int32_t *cells, float *grids, float *height)
{
    long wide = side + 2 * border, size = wide * wide;
    float *lowest = grids, *other = grids + size;
    for (long i = 0; i < 2 * size; i++) grids[i] = INFINITY;
    for (long i = 0; i < n; i++) {
        const float *point = points + 3 * i;
        int32_t row = (int32_t)((point[0] + range_m) * per_m);
        int32_t column = (int32_t)((point[1] + range_m) * per_m);
        cells[i] = (int32_t)((row + border) * wide + column + border);
        if (point[2] < lowest[cells[i]]) lowest[cells[i]] = point[2];
    }
    for (long row = 0; row < side; row++) {
        const float *here = row_of(lowest, wide, border, row);
        const float *up = here - wide, *down = here + wide;
        float *restrict level = row_of(other, wide, border, row);
        for (long j = 0; j < side; j++) {
            float left = least(here[j - 1], least(up[j - 1], down[j - 1]));
            float right = least(here[j + 1], least(up[j + 1], down[j + 1]));
            float around = least(least(left, right), least(up[j], down[j]));
            level[j] = around < INFINITY && here[j] < around - pit_m ? around : here[j];
        }
    }
    float *from = other, *to = lowest;
    for (int along = 0; along < 2; along++)
        for (long k = 0; k < count; k++) {
            long apart = steps[k] * (along ? 1 : wide);
            for (long row = 0; row < side; row++) {
                const float *here = row_of(from, wide, border, row);
                bound(here - apart, here, here + apart, rises[k], side,
                      row_of(to, wide, border, row));
            }
            float *swapped = from;
            from = to;
            to = swapped;
        }
    for (long i = 0; i < n; i++) height[i] = points[3 * i + 2] - from[cells[i]];
}

/* Objects among points (n, 3): those with a height between `low` and `high`, in connected cells
   (corners connect) that hold `least_points` or more together: see `_components` of
   perception/scene/fast.py. `members` and `labels` take up to n, `found` what was found: how many
   members and how many objects. Cells as in `heights_above`. Scratch: `cells` (n), `grid` side^2,
   `stack` the larger of n + 1 and side^2. */
void find_objects(const float *points, const float *height, long n, float low, float high,
                  float range_m, float per_m, long side, long least_points, int32_t *cells,
                  int32_t *grid, int32_t *stack, int64_t *members, int32_t *labels, int64_t *found)
{
    int32_t first_row = (int32_t)side, last_row = -1, first_column = (int32_t)side, last_column = -1;
    long standing = 0;
    for (long i = 0; i < n; i++) {
        if (!(height[i] > low && height[i] < high)) continue;
        int32_t row = (int32_t)((points[3 * i] + range_m) * per_m);
        int32_t column = (int32_t)((points[3 * i + 1] + range_m) * per_m);
        if (row < first_row) first_row = row;
        if (row > last_row) last_row = row;
        if (column < first_column) first_column = column;
        if (column > last_column) last_column = column;
        cells[standing] = (int32_t)(row * side + column);
        members[standing++] = i;
    }
    found[0] = found[1] = 0;
    if (!standing) return;
    /* All else is done in the rectangle that holds the occupied cells. */
    int32_t wide = last_column - first_column + 1, tall = last_row - first_row + 1;
    memset(grid, 0, sizeof(int32_t) * wide * tall);
    for (long i = 0; i < standing; i++) {
        int32_t row = cells[i] / (int32_t)side - first_row;
        int32_t column = cells[i] % (int32_t)side - first_column;
        grid[cells[i] = row * wide + column] = -1;
    }
    int32_t objects = 0;
    for (int32_t seed = 0; seed < wide * tall; seed++) {
        if (grid[seed] != -1) continue;
        long depth = 0;
        grid[seed] = ++objects;
        stack[depth++] = seed;
        while (depth) {
            int32_t at = stack[--depth], row = at / wide, column = at % wide;
            for (int32_t i = row > 0 ? row - 1 : 0; i <= row + 1 && i < tall; i++)
                for (int32_t j = column > 0 ? column - 1 : 0; j <= column + 1 && j < wide; j++)
                    if (grid[i * wide + j] == -1) {
                        grid[i * wide + j] = objects;
                        stack[depth++] = i * wide + j;
                    }
        }
    }
    /* The stack is free again: points of each object, then its label. */
    memset(stack, 0, sizeof(int32_t) * (objects + 1));
    for (long i = 0; i < standing; i++) stack[grid[cells[i]]]++;
    for (int32_t object = 1; object <= objects; object++)
        stack[object] = stack[object] >= least_points ? (int32_t)found[1]++ : -1;
    for (long i = 0; i < standing; i++) {
        int32_t label = stack[grid[cells[i]]];
        if (label < 0) continue;
        members[found[0]] = members[i];
        labels[found[0]++] = label;
    }
}

/* Azimuth of a point that is not the origin, to 2e-6 radians: a polynomial fitted to the arc tangent
   between 0 and 1. */
static float azimuth_of(float x, float y)
{
    float ahead = fabsf(x), aside = fabsf(y);
    float ratio = (aside < ahead ? aside : ahead) / (aside < ahead ? ahead : aside);
    float s = ratio * ratio;
    float turn = -0.01171911f * s + 0.0526473f;
    turn = turn * s - 0.11642646f;
    turn = turn * s + 0.19354038f;
    turn = turn * s - 0.33262283f;
    turn = (turn * s + 0.99997723f) * ratio;
    if (aside > ahead) turn = 1.57079633f - turn;
    if (x < 0) turn = 3.14159265f - turn;
    return y < 0 ? -turn : turn;
}

/* Which of the points (n, 3) named by `index` can be the nearest (or farthest) of their ray, of
   `rays` in a turn from azimuth -yaw on: of each ray that one, and every point so close to a border
   between rays that `azimuth_of` cannot tell its ray. Their positions in `chosen`, up to `count`,
   are returned by number. Scratch: `square` and `best` (rays). */
long ray_ends(const float *points, const int64_t *index, long count, float yaw, float per_rad,
              long rays, int farthest, double *square, int64_t *best, int64_t *chosen)
{
    static const float margin = 2e-3f;
    long found = 0;
    for (long ray = 0; ray < rays; ray++) best[ray] = -1;
    for (long i = 0; i < count; i++) {
        float x = points[3 * index[i]], y = points[3 * index[i] + 1];
        float position = (x == 0 && y == 0) ? 0 : (azimuth_of(x, y) + yaw) * per_rad;
        long ray = (long)position - (position < 0);
        float over = position - ray;
        if (over < margin || over > 1 - margin) {
            chosen[found++] = index[i];
            continue;
        }
        /* A division takes longer than the turn or two that an azimuth and a yaw can be off. */
        while (ray < 0) ray += rays;
        while (ray >= rays) ray -= rays;
        double apart = (double)x * x + (double)y * y;
        if (best[ray] < 0 || (farthest ? apart > square[ray] : apart < square[ray])) {
            best[ray] = index[i];
            square[ray] = apart;
        }
    }
    for (long ray = 0; ray < rays; ray++)
        if (best[ray] >= 0) chosen[found++] = best[ray];
    return found;
}

/* Of the points (n, 3) of each cell of a square grid with `half` cells on each side of the origin,
   as far as they stand: less than `reach_m` from the origin along x and y, and not `ground` (n).
   How many, their lowest and highest z, and the sums of x and y: arrays of
   the cells that have points, x first, up to n of them, of which the number is returned. Scratch:
   `cells` (n), `grid` (2 half)^2. */
long gather_cells(const float *points, const uint8_t *ground, long n, float reach_m, float cell_m,
                  long half, int32_t *cells, int32_t *grid, int64_t *count, double *low,
                  double *high, double *x, double *y)
{
    long side = 2 * half, used = 0;
    memset(grid, 0, sizeof(int32_t) * side * side);
    for (long i = 0; i < n; i++) {
        const float *point = points + 3 * i;
        cells[i] = -1;
        if (ground[i]) continue;
        if (!(fabsf(point[0]) < reach_m && fabsf(point[1]) < reach_m)) continue;
        long column = (long)floorf(point[0] / cell_m) + half;
        long row = (long)floorf(point[1] / cell_m) + half;
        if (column < 0 || column >= side || row < 0 || row >= side) continue;
        cells[i] = (int32_t)(column * side + row);
        grid[cells[i]] = 1;
    }
    for (long at = 0; at < side * side; at++)
        if (grid[at]) grid[at] = (int32_t)used++;
    memset(count, 0, sizeof(int64_t) * used);
    for (long i = 0; i < n; i++) {
        if (cells[i] < 0) continue;
        const float *point = points + 3 * i;
        int32_t at = grid[cells[i]];
        if (!count[at]++) {
            low[at] = high[at] = point[2];
            x[at] = y[at] = 0.0;
        }
        if (point[2] < low[at]) low[at] = point[2];
        if (point[2] > high[at]) high[at] = point[2];
        x[at] += point[0];
        y[at] += point[1];
    }
    return used;
}

/* Lays a stamp (2 reach + 1)^2 on an image (side, side) around each of n cells, and keeps what is
   larger; nothing is laid on its border. The same for a second stamp and image. */
void stamp(float *image, float *other, long side, long border, const int64_t *row,
           const int64_t *column, long n, const float *mark, const float *other_mark, long reach)
{
    for (long k = 0; k < n; k++)
        for (long i = -reach; i <= reach; i++)
            for (long j = -reach; j <= reach; j++) {
                long y = row[k] + i, x = column[k] + j;
                if (y < border || y >= side - border || x < border || x >= side - border) continue;
                long from = (i + reach) * (2 * reach + 1) + j + reach, to = y * side + x;
                if (mark[from] > image[to]) image[to] = mark[from];
                if (other_mark[from] > other[to]) other[to] = other_mark[from];
            }
}

/* Sums of an image (side, side) over n cells that are all shifted by -reach to reach rows and
   columns, for each of several sets of cells (sets, n): (sets, 2 reach + 1, 2 reach + 1). */
void sum_shifted(const float *image, long side, const int64_t *cells, long sets, long n, long reach,
                 float *sums)
{
    long wide = 2 * reach + 1;
    memset(sums, 0, sizeof(float) * sets * wide * wide);
    for (long s = 0; s < sets; s++, sums += wide * wide)
        for (long k = 0; k < n; k++) {
            const float *from = image + cells[s * n + k] - reach * side - reach;
            for (long i = 0; i < wide; i++)
                for (long j = 0; j < wide; j++) sums[i * wide + j] += from[i * side + j];
        }
}

/* Sums of an image (side, side) of cells of cell_m, from -reach_m on, over places (n, 2) under
   several moves (x, y, cos, sin): a turn about `center`, around which the places lie, and a shift.
   Places beyond the image count to its edge. */
void sum_moved(const float *image, long side, double cell_m, double reach_m, const double *places,
               long n, const double *center, const double *moves, long count, float *sums)
{
    for (long m = 0; m < count; m++, moves += 4) {
        float sum = 0.0f;
        for (long k = 0; k < n; k++) {
            double x = places[2 * k], y = places[2 * k + 1];
            double to_x = moves[2] * x - moves[3] * y + (center[0] + moves[0]);
            double to_y = moves[3] * x + moves[2] * y + (center[1] + moves[1]);
            double column = floor((to_x + reach_m) / cell_m), row = floor((to_y + reach_m) / cell_m);
            column = column > 0 ? column < side - 1 ? column : side - 1 : 0;
            row = row > 0 ? row < side - 1 ? row : side - 1 : 0;
            sum += image[(long)row * side + (long)column];
        }
        sums[m] = sum;
    }
}
