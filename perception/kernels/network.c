/* The detector's network: points to image, and convolutions.

   Images are float32 (rows, columns, channels); a pitch is the number of floats from one cell to
   the next, so that an image may lie in part of the channels of a wider one. Channels that are
   written are multiples of 16, the columns of a panel of weights. The threads of a team share the
   rows of a convolution, each with scratch of its own.
   perception/kernels/library.py declares what is called. */

#include <math.h>
#include <string.h>

#include "team.h"

/* Raise with any change of what functions take: perception/kernels/library.py has the same. */
int loops_version(void) { return 3; }

#if defined(__AVX512F__)
#define LANES 16
#define ROWS 12
#elif defined(__AVX2__)
#define LANES 8
#define ROWS 6
#else
#define LANES 4
#define ROWS 3
#endif
#define PANEL 16
#define PARTS (PANEL / LANES)
#define BLOCK 12 /* tiles or cells at once: what belongs to them stays in the second cache */
#define INLINE static inline __attribute__((always_inline))

typedef float vec __attribute__((vector_size(4 * LANES), aligned(4)));
typedef int mask __attribute__((vector_size(4 * LANES), aligned(4)));
#define AT(place) (*(vec *)(place))
#define GET(place) (*(const vec *)(place))

INLINE vec positive(vec x) { return (vec)((mask)x & (x > 0)); }

/* c (rows, 16) = a (rows, k) b (k, 16) */
INLINE void product(const float *a, long pitch, const float *b, long k, float *c, long c_pitch,
                    int rows)
{
    vec sum[ROWS][PARTS];
    for (int r = 0; r < rows; r++)
        for (int p = 0; p < PARTS; p++) sum[r][p] = (vec){0};
    for (long i = 0; i < k; i++) {
        vec w[PARTS];
        for (int p = 0; p < PARTS; p++) w[p] = GET(b + PANEL * i + LANES * p);
        for (int r = 0; r < rows; r++)
            for (int p = 0; p < PARTS; p++) sum[r][p] += a[r * pitch + i] * w[p];
    }
    for (int r = 0; r < rows; r++)
        for (int p = 0; p < PARTS; p++) AT(c + r * c_pitch + LANES * p) = sum[r][p];
}

/* c (n, columns) = a (n, k) b, whose columns come in panels of 16: (columns / 16, k, 16) */
static void multiply(const float *a, long pitch, const float *b, long k, float *c, long c_pitch,
                     int n, int columns)
{
    for (int j = 0; j < columns; j += PANEL, b += PANEL * k) {
        int r = 0;
        for (; r + ROWS <= n; r += ROWS)
            product(a + r * pitch, pitch, b, k, c + r * c_pitch + j, c_pitch, ROWS);
        for (; r < n; r++) product(a + r * pitch, pitch, b, k, c + r * c_pitch + j, c_pitch, 1);
    }
}

/* Winograd's F(4 x 4, 3 x 3): Lavin and Gray, "Fast Algorithms for Convolutional Neural Networks",
   CVPR 2016. A tile of 6 x 6 cells gives 4 x 4, with a fourth of the multiplications. */
INLINE void into(const vec *d, int step, vec *out, int out_step)
{
    vec d0 = d[0], d1 = d[step], d2 = d[2 * step], d3 = d[3 * step], d4 = d[4 * step];
    vec a = d4 - 4 * d2, b = d3 - 4 * d1, c = d4 - d2, e = 2 * (d3 - d1);
    out[0] = 4 * d0 - 5 * d2 + d4;
    out[out_step] = a + b;
    out[2 * out_step] = a - b;
    out[3 * out_step] = c + e;
    out[4 * out_step] = c - e;
    out[5 * out_step] = 4 * d1 - 5 * d3 + d[5 * step];
}

INLINE void out_of(const vec *m, int step, vec *out)
{
    vec a = m[step] + m[2 * step], b = m[step] - m[2 * step];
    vec c = m[3 * step] + m[4 * step], e = m[3 * step] - m[4 * step];
    out[0] = m[0] + a + c;
    out[1] = b + 2 * e;
    out[2] = a + 4 * c;
    out[3] = b + 8 * e + m[5 * step];
}

static void tile_into(const float *from, long right, long down, int channels, float *v, long step)
{
    for (int c = 0; c < channels; c += LANES) {
        vec half[36];
        for (int i = 0; i < 6; i++) {
            vec row[6];
            for (int j = 0; j < 6; j++) row[j] = GET(from + i * down + j * right + c);
            into(row, 1, half + 6 * i, 1);
        }
        for (int j = 0; j < 6; j++) {
            vec column[6];
            into(half + j, 6, column, 1);
            for (int i = 0; i < 6; i++) AT(v + (6 * i + j) * step + c) = column[i];
        }
    }
}

/* Floats of scratch for `convolve3`, for each thread. */
long scratch3(int before, int after) { return 36L * (BLOCK * (before + after) + before); }

/* out = 3 x 3 convolution of `in`, zero beyond the border, + bias (+ `add`), not negative where
   `relu`. Tiles (rows / 4, columns / 4, rounded up) that are not `needed` become 0; without it, all
   are. weights: (36, after / 16, before, 16), in Winograd's form. */
typedef struct {
    const float *in, *weights, *bias, *add;
    const unsigned char *needed;
    float *out, *scratch;
    int in_pitch, rows, columns, before, after, add_pitch, relu, out_pitch;
} layer3;

/* For the rows of tiles (4 rows of cells each) from `first` to `last`. */
static void rows_of_convolve3(const void *given, int first, int last, int who)
{
    const layer3 *l = given;
    const float *in = l->in, *weights = l->weights, *bias = l->bias, *add = l->add;
    const unsigned char *needed = l->needed;
    float *out = l->out;
    int in_pitch = l->in_pitch, rows = l->rows, columns = l->columns, before = l->before;
    int after = l->after, add_pitch = l->add_pitch, relu = l->relu, out_pitch = l->out_pitch;
    float *v = l->scratch + who * scratch3(before, after);
    float *m = v + 36L * BLOCK * before, *edge = m + 36L * BLOCK * after;
    int across = (columns + 3) / 4, next = first * across, end = last * across;
    while (next < end) {
        int tile[BLOCK], n = 0;
        for (; next < end && n < BLOCK; next++) {
            if (!needed || needed[next]) {
                tile[n++] = next;
                continue;
            }
            int y = next / across * 4, x = next % across * 4;
            for (int i = y; i < y + 4 && i < rows; i++)
                for (int j = x; j < x + 4 && j < columns; j++)
                    memset(out + ((long)i * columns + j) * out_pitch, 0, sizeof(float) * after);
        }
        for (int t = 0; t < n; t++) {
            int y = tile[t] / across * 4 - 1, x = tile[t] % across * 4 - 1;
            long right = in_pitch, down = (long)columns * in_pitch;
            const float *from = in + y * down + x * right;
            if (y < 0 || x < 0 || y + 6 > rows || x + 6 > columns) {
                for (int i = 0; i < 6; i++)
                    for (int j = 0; j < 6; j++) {
                        float *cell = edge + (6 * i + j) * before;
                        if (y + i < 0 || y + i >= rows || x + j < 0 || x + j >= columns)
                            memset(cell, 0, sizeof(float) * before);
                        else
                            memcpy(cell, from + i * down + j * right, sizeof(float) * before);
                    }
                from = edge, right = before, down = 6 * before;
            }
            tile_into(from, right, down, before, v + (long)t * before, (long)BLOCK * before);
        }
        for (int p = 0; p < 36; p++)
            multiply(v + (long)p * BLOCK * before, before, weights + (long)p * before * after,
                     before, m + (long)p * BLOCK * after, after, n, after);
        for (int t = 0; t < n; t++) {
            int y = tile[t] / across * 4, x = tile[t] % across * 4;
            int high = rows - y < 4 ? rows - y : 4, wide = columns - x < 4 ? columns - x : 4;
            for (int c = 0; c < after; c += LANES) {
                vec half[24], b = GET(bias + c);
                for (int i = 0; i < 6; i++) {
                    vec row[6], found[4];
                    for (int j = 0; j < 6; j++)
                        row[j] = GET(m + ((6L * i + j) * BLOCK + t) * after + c);
                    out_of(row, 1, found);
                    for (int j = 0; j < 4; j++) half[4 * i + j] = found[j];
                }
                for (int j = 0; j < wide; j++) {
                    vec found[4];
                    out_of(half + j, 4, found);
                    for (int i = 0; i < high; i++) {
                        long at = (long)(y + i) * columns + x + j;
                        vec value = found[i] + b;
                        if (add) value += GET(add + at * add_pitch + c);
                        AT(out + at * out_pitch + c) = relu ? positive(value) : value;
                    }
                }
            }
        }
    }
}

void convolve3(team *team, const float *in, int in_pitch, int rows, int columns, int before,
               const float *weights, const float *bias, int after, const float *add, int add_pitch,
               int relu, const unsigned char *needed, float *out, int out_pitch, float *scratch)
{
    layer3 l = {in, weights, bias, add, needed, out, scratch,
                in_pitch, rows, columns, before, after, add_pitch, relu, out_pitch};
    share(team, rows_of_convolve3, &l, (rows + 3) / 4);
}

/* Floats of scratch for `convolve`, for each thread. */
long scratch(int kernel, int before, int after)
{
    return (long)BLOCK * (kernel * kernel * before + after);
}

/* out = kernel x kernel convolution of `in` at a stride, zero beyond the border, + bias, not
   negative where `relu`, (+ `add`), each cell repeated `repeat` times along both axes. `rows`,
   `columns`: those of `in`; `out_rows`, `out_columns`: those of `out`. weights: (after / 16,
   kernel, kernel, before, 16). */
typedef struct {
    const float *in, *weights, *bias, *add;
    float *out, *scratch;
    int in_pitch, rows, columns, before, kernel, stride, after, add_pitch, relu, repeat, out_pitch;
    int out_rows, out_columns;
} layer;

/* For the rows of cells, before they are repeated, from `first` to `last`. */
static void rows_of_convolve(const void *given, int first, int last, int who)
{
    const layer *l = given;
    const float *in = l->in, *weights = l->weights, *bias = l->bias, *add = l->add;
    float *out = l->out;
    int in_pitch = l->in_pitch, rows = l->rows, columns = l->columns, before = l->before;
    int kernel = l->kernel, stride = l->stride, after = l->after, add_pitch = l->add_pitch;
    int relu = l->relu, repeat = l->repeat, out_pitch = l->out_pitch;
    int out_rows = l->out_rows, out_columns = l->out_columns;
    int across = (columns + stride - 1) / stride, k = kernel * kernel * before;
    float *patch = l->scratch + who * scratch(kernel, before, after);
    float *found = patch + (long)BLOCK * k;
    for (int y = first; y < last; y++)
        for (int begin = 0; begin < across; begin += BLOCK) {
            int n = across - begin < BLOCK ? across - begin : BLOCK;
            const float *a = in + ((long)y * columns + begin) * in_pitch;
            long pitch = in_pitch;
            if (kernel > 1 || stride > 1) {
                for (int t = 0; t < n; t++)
                    for (int i = 0; i < kernel; i++)
                        for (int j = 0; j < kernel; j++) {
                            int from_y = y * stride + i - kernel / 2;
                            int from_x = (begin + t) * stride + j - kernel / 2;
                            float *cell = patch + (long)t * k + (i * kernel + j) * before;
                            if (from_y < 0 || from_y >= rows || from_x < 0 || from_x >= columns)
                                memset(cell, 0, sizeof(float) * before);
                            else
                                memcpy(cell, in + ((long)from_y * columns + from_x) * in_pitch,
                                       sizeof(float) * before);
                        }
                a = patch, pitch = k;
            }
            multiply(a, pitch, weights, k, found, after, n, after);
            for (int t = 0; t < n; t++)
                for (int i = 0; i < repeat && y * repeat + i < out_rows; i++)
                    for (int j = 0; j < repeat && (begin + t) * repeat + j < out_columns; j++) {
                        long at = (long)(y * repeat + i) * out_columns + (begin + t) * repeat + j;
                        for (int c = 0; c < after; c += LANES) {
                            vec value = GET(found + t * after + c) + GET(bias + c);
                            if (relu) value = positive(value);
                            if (add) value += GET(add + at * add_pitch + c);
                            AT(out + at * out_pitch + c) = value;
                        }
                    }
        }
}

void convolve(team *team, const float *in, int in_pitch, int rows, int columns, int before,
              int kernel, int stride, const float *weights, const float *bias, int after,
              const float *add, int add_pitch, int relu, int repeat, float *out, int out_pitch,
              int out_rows, int out_columns, float *scratch)
{
    layer l = {in, weights, bias, add, out, scratch,
               in_pitch, rows, columns, before, kernel, stride, after, add_pitch, relu, repeat,
               out_pitch, out_rows, out_columns};
    share(team, rows_of_convolve, &l, (rows + stride - 1) / stride);
}

/* Features (cells, channels) to 0 to 1, and to 0 where nothing was said. */
void limit(float *features, const unsigned char *said, long cells, int channels)
{
    for (long i = 0; i < cells; i++, features += channels)
        for (int c = 0; c < channels; c += LANES) {
            vec x = positive(GET(features + c)), one = (vec){0} + 1;
            AT(features + c) = said[i] ? (vec)(((mask)x & (x < 1)) | ((mask)one & (x >= 1)))
                                       : (vec){0};
        }
}

/* Ints of scratch for `image`. */
long image_scratch(int rows, int columns, long points)
{
    return 17L * rows * columns + 2 * points;
}

/* Points (n, 3) of one cloud to the encoder's image (rows, columns, 32), and to 1 in `filled` (rows,
   columns) where a point is. Four pillars make a cell: see perception/detector/pillars.py, whose
   features of a point are computed here in the same way. `low`, `high`: of z. layer: (7, 32) and 32
   of bias; down: panels of (128, 32) and 32 of bias. `seen` holds 160 floats for every cell that
   may have a point. Returns how many have one. */
long image(const float *points, long n, float half_x, float half_y, float low, float high,
           float pillar, int rows, int columns, const float *layer, const float *down,
           const float *down_bias, float *out, unsigned char *filled, int *scratch, float *seen)
{
    enum { WIDTH = 32, PILLARS = 4 };
    long cells = (long)rows * columns, pillars = cells * PILLARS, kept = 0, known = 0;
    int *count = scratch, *place = count + pillars, *index = place + cells, *which = index + n;
    float *sums = (float *)(which + n);
    memset(count, 0, sizeof(int) * pillars);
    memset(sums, 0, sizeof(float) * 3 * pillars);
    memset(filled, 0, cells);
    for (long i = 0; i < n; i++) {
        float x = points[3 * i], y = points[3 * i + 1], z = points[3 * i + 2];
        if (!(fabsf(x) < half_x && fabsf(y) < half_y && z > low && z < high)) continue;
        int column = (int)((x + half_x) / pillar), row = (int)((y + half_y) / pillar);
        /* float32 may round a point just below the edge up to it */
        if (column >= 2 * columns) column = 2 * columns - 1;
        if (row >= 2 * rows) row = 2 * rows - 1;
        long cell = (long)(row / 2) * columns + column / 2;
        int p = (int)(cell * PILLARS + row % 2 * 2 + column % 2);
        index[kept] = p, which[kept++] = (int)i;
        count[p]++;
        sums[3 * p] += x, sums[3 * p + 1] += y, sums[3 * p + 2] += z;
        if (!filled[cell]) filled[cell] = 1, place[cell] = (int)known++;
    }
    float *result = seen + known * WIDTH * PILLARS;
    memset(seen, 0, sizeof(float) * known * WIDTH * PILLARS);
    for (long i = 0; i < kept; i++) {
        const float *point = points + 3L * which[i];
        int p = index[i], cell = p / PILLARS, part = p % PILLARS;
        int column = cell % columns * 2 + part % 2, row = cell / columns * 2 + part / 2;
        float many = (float)count[p];
        float told[7] = {
            point[0] - sums[3 * p] / many,
            point[1] - sums[3 * p + 1] / many,
            point[2] - sums[3 * p + 2] / many,
            (point[0] - ((column + 0.5f) * pillar - half_x)) / pillar,
            (point[1] - ((row + 0.5f) * pillar - half_y)) / pillar,
            point[2],
            logf(many) / 4.0f,
        };
        float *most = seen + ((long)place[cell] * PILLARS + part) * WIDTH;
        for (int c = 0; c < WIDTH; c += LANES) {
            vec value = GET(layer + 7 * WIDTH + c), before = GET(most + c);
            for (int f = 0; f < 7; f++) value += told[f] * GET(layer + f * WIDTH + c);
            mask larger = value > before;
            AT(most + c) = (vec)(((mask)value & larger) | ((mask)before & ~larger));
        }
    }
    multiply(seen, WIDTH * PILLARS, down, WIDTH * PILLARS, result, WIDTH, (int)known, WIDTH);
    for (long i = 0; i < cells; i++)
        for (int c = 0; c < WIDTH; c += LANES) {
            vec value = GET(down_bias + c);
            if (filled[i]) value += GET(result + place[i] * (long)WIDTH + c);
            AT(out + i * WIDTH + c) = positive(value);
        }
    return known;
}

/* Attention of each cell of the first map over all maps (see perception/fusion/maps.py): maps of
   (cells, channels) and which cells of each are present, the first's all. */
void attend(const float *const *maps, const unsigned char *const *present, int count, long cells,
            int channels, float *out)
{
    float scale = 1.0f / sqrtf((float)channels);
    for (long i = 0; i < cells; i++) {
        const float *own = maps[0] + i * channels;
        float weights[256], most = 0.0f, total = 0.0f;
        for (int k = 0; k < count; k++) {
            weights[k] = -INFINITY;
            if (k > 0 && !present[k][i]) continue;
            vec sum = {0};
            for (int c = 0; c < channels; c += LANES)
                sum += GET(own + c) * GET(maps[k] + i * channels + c);
            weights[k] = 0.0f;
            for (int lane = 0; lane < LANES; lane++) weights[k] += sum[lane];
            weights[k] *= scale;
            if (k == 0 || weights[k] > most) most = weights[k];
        }
        for (int k = 0; k < count; k++)
            total += weights[k] = weights[k] == -INFINITY ? 0.0f : expf(weights[k] - most);
        for (int c = 0; c < channels; c += LANES) {
            vec sum = {0};
            for (int k = 0; k < count; k++)
                if (weights[k] != 0.0f)
                    sum += (weights[k] / total) * GET(maps[k] + i * channels + c);
            AT(out + i * channels + c) = sum;
        }
    }
}
