/* What stands around a robot, and how well it lies over what the ego sees: the loops of
   perception/fusion/outline.py and alignment.py. */

#include <math.h>
#include <stdint.h>
#include <string.h>

/* Raise with any change of what functions take: perception/kernels/library.py has the same. */
int loops_version(void) { return 2; }

/* Of the points (n, 3) in each cell of a square grid with `half` cells on each side of the origin:
   how many, their lowest and highest z, and the sums of x and y. Arrays of (2 half)^2, x first. */
void gather_cells(const float *points, long n, float cell_m, long half, int64_t *count, double *low,
                  double *high, double *x, double *y)
{
    long side = 2 * half;
    memset(count, 0, sizeof(int64_t) * side * side);
    for (long i = 0; i < n; i++) {
        const float *point = points + 3 * i;
        long column = (long)floorf(point[0] / cell_m) + half;
        long row = (long)floorf(point[1] / cell_m) + half;
        if (column < 0 || column >= side || row < 0 || row >= side) continue;
        long at = column * side + row;
        if (!count[at]++) {
            low[at] = high[at] = point[2];
            x[at] = y[at] = 0.0;
        }
        if (point[2] < low[at]) low[at] = point[2];
        if (point[2] > high[at]) high[at] = point[2];
        x[at] += point[0];
        y[at] += point[1];
    }
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
