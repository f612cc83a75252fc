/* The point codec's loops: see perception/codec, whose bytes these write and read, bit for bit. */

#include <stdint.h>

/* Raise with any change of what functions take: perception/kernels/library.py has the same. */
int loops_version(void) { return 3; }

enum { PRECISION = 12, TOTAL = 1 << PRECISION };
static const uint32_t LOW = 1u << 16;

/* Symbols of runs of given lengths, the last one first and each from its end, onto the lanes'
   states. `contexts`, `symbols` and `words` end with those of the last run; words are written
   downwards from there. Returns how many words that were. */
long rans_put(const int32_t *contexts, const uint8_t *symbols, const int64_t *lengths, long runs,
              long n, const uint32_t *frequencies, const uint32_t *starts, long width,
              uint32_t *state, long lanes, uint16_t *words)
{
    uint16_t *word = words + n;
    contexts += n;
    symbols += n;
    for (long run = runs - 1; run >= 0; run--) {
        contexts -= lengths[run];
        symbols -= lengths[run];
        for (long begin = lengths[run] > 0 ? (lengths[run] - 1) / lanes * lanes : -1; begin >= 0;
             begin -= lanes) {
            long left = lengths[run] - begin;
            for (long lane = (left < lanes ? left : lanes) - 1; lane >= 0; lane--) {
                long cell = contexts[begin + lane] * width + symbols[begin + lane];
                uint32_t frequency = frequencies[cell], x = state[lane];
                if (x >= (uint64_t)frequency << (32 - PRECISION)) {
                    *--word = (uint16_t)x;
                    x >>= 16;
                }
                state[lane] = x / frequency * (TOTAL - frequency) + x + starts[cell];
            }
        }
    }
    return words + n - word;
}

/* The symbols of one run of contexts. Reads words from `at` on, of which there are `end` and one a
   lane more; returns where the next one lies, or -1 when there are too few. */
long rans_take(const int32_t *contexts, long n, const uint8_t *slots, const uint32_t *frequencies,
               const uint32_t *starts, long width, uint32_t *state, long lanes,
               const uint16_t *words, long at, long end, uint8_t *symbols)
{
    for (long begin = 0; begin < n; begin += lanes) {
        long here = n - begin < lanes ? n - begin : lanes;
        for (long lane = 0; lane < here; lane++) {
            uint32_t x = state[lane], slot = x & (TOTAL - 1);
            long context = contexts[begin + lane];
            uint8_t symbol = slots[(context << PRECISION) + slot];
            symbols[begin + lane] = symbol;
            x = (x >> PRECISION) * frequencies[context * width + symbol] + slot
                - starts[context * width + symbol];
            long hungry = x < LOW;
            state[lane] = hungry ? x << 16 | words[at] : x;
            at += hungry;
        }
        if (at > end) return -1;
    }
    return at;
}

enum { UNIT_BITS = 6, UNIT = 1 << UNIT_BITS, MAGNITUDES = 9, SURROUNDINGS = 9, ACTIVITY_CAP = 64 };

/* int32 that wraps around, as NumPy's does */
static int32_t sum(int32_t a, int32_t b) { return (int32_t)((uint32_t)a + (uint32_t)b); }
static int32_t less(int32_t a, int32_t b) { return (int32_t)((uint32_t)a - (uint32_t)b); }
static int32_t times(int32_t a, int32_t b) { return (int32_t)((uint32_t)a * (uint32_t)b); }
static int32_t size_of(int32_t a) { return a < 0 ? less(0, a) : a; }

typedef struct { int32_t prediction, gap, seen, activity; } Between;

/* Mean and difference of two neighbours: see `_between` of perception/codec/interlace.py. */
static Between between(int32_t value_a, int32_t value_b, int32_t present_a, int32_t present_b,
                       int32_t activity_a, int32_t activity_b)
{
    int32_t difference = less(value_a, value_b);
    int32_t lean = times(times(difference, 7) >> 4, present_a - present_b);
    return (Between){
        .prediction = sum(sum(value_a, value_b) >> 1, lean),
        .gap = size_of(difference),
        .seen = present_a + present_b,
        .activity = sum(activity_a, activity_b),
    };
}

static int32_t context_of(int32_t kind, int32_t expected, int32_t seen)
{
    static const int32_t limits[] = {3, 8, 16, 32, 64, 128, 256, 520};
    int32_t magnitude = 0;
    while (magnitude < 8 && expected >= limits[magnitude]) magnitude++;
    return (magnitude + kind * MAGNITUDES) * SURROUNDINGS + seen;
}

/* Predictions and contexts of one pass over an image (columns, rings), of whose columns every
   `spacing`-th is known: the columns in the middle between, in the even rings, or in the odd ones
   when the even ones are known. Out: (new columns, rings of the pass). */
static void ask(const int32_t *value, const uint8_t *present, const int32_t *activity, long columns,
                long rings, long spacing, int odd, int32_t *prediction, int32_t *context)
{
    for (long column = spacing / 2; column < columns; column += spacing) {
        long left = (column - spacing / 2) * rings;
        long right = (column + spacing / 2) % columns * rings;
        for (long ring = odd; ring < rings; ring += 2, prediction++, context++) {
#define SIDES(r) between(value[left + (r)], value[right + (r)], present[left + (r)], \
                         present[right + (r)], activity[left + (r)], activity[right + (r)])
            Between sides = SIDES(ring);
            if (!odd) {
                Between above = ring > 0 ? SIDES(ring - 1) : sides;
                Between below = ring + 1 < rings ? SIDES(ring + 1) : sides;
                int32_t around = sum(above.activity, below.activity);
                int32_t busy = sum(times(2, sides.activity), around) >> 2;
                *prediction = sides.prediction;
                *context = context_of(0, sum(sides.gap >> 3, busy),
                                      2 * sides.seen + above.seen + below.seen);
                continue;
            }
            long above = column * rings + ring - 1, below = ring + 1 < rings ? above + 2 : above;
            Between levels = between(value[above], value[below], present[above],
                                     below == above ? 0 : present[below], activity[above],
                                     activity[below]);
            int32_t doubt = sum(sides.gap, (2 - sides.seen) << UNIT_BITS);
            int32_t level_doubt = sum(levels.gap, (2 - levels.seen) << UNIT_BITS);
            int32_t most = doubt > level_doubt ? doubt : level_doubt;
            int32_t least = doubt < level_doubt ? doubt : level_doubt;
            int32_t gap = sides.gap < levels.gap ? sides.gap : levels.gap;
            int32_t apart = sum(gap, size_of(less(sides.prediction, levels.prediction)));
            *prediction = level_doubt < doubt ? levels.prediction : sides.prediction;
            if (most < sum(times(3, least), 2 * UNIT))
                *prediction = sum(sides.prediction, levels.prediction) >> 1;
            *context = context_of(1, sum(apart >> 4, sum(sides.activity, levels.activity) >> 1),
                                  2 * (sides.seen + levels.seen));
        }
    }
}

/* Takes up the answers to `ask`: residuals in steps and returns of the first `asked` new
   columns; those beyond take their prediction. */
static void tell(int32_t *value, uint8_t *present, int32_t *activity, long columns, long rings,
                 long spacing, int odd, long asked, const int32_t *prediction,
                 const int32_t *residual, const uint8_t *answered)
{
    for (long column = spacing / 2, i = 0; column < columns; column += spacing, asked--) {
        long left = (column - spacing / 2) * rings;
        long right = (column + spacing / 2) % columns * rings;
        for (long ring = odd; ring < rings; ring += 2, i++) {
            long at = column * rings + ring;
            value[at] = prediction[i];
            present[at] = 0;
            activity[at] = sum(activity[left + ring], activity[right + ring]) >> 1;
            if (asked <= 0) continue;
            value[at] = sum(value[at], times(residual[i], UNIT));
            present[at] = answered[i];
            if (answered[i]) {
                int32_t size = size_of(residual[i]);
                activity[at] = times(size < ACTIVITY_CAP ? size : ACTIVITY_CAP, 16);
            }
        }
    }
}

/* Residuals and returns of symbols, with raw bits from bit `at` on of `bits`, which has 4 bytes more
   than it says; `base` and `raw` are those of the classes. Returns the next bit, or -1 beyond
   `end`. See perception/codec/residuals.py. */
long residuals_read(const uint8_t *symbols, long n, const int32_t *base, const int32_t *raw,
                    const uint8_t *bits, long at, long end, int32_t *residual, uint8_t *present)
{
    for (long i = 0; i < n; i++) {
        int32_t kind = symbols[i] >> 1, size = base[kind], length = raw[kind];
        if (length) {
            const uint8_t *octet = bits + (at >> 3);
            if ((at += length) > end) return -1;
            uint32_t window = (uint32_t)octet[0] << 24 | octet[1] << 16 | octet[2] << 8 | octet[3];
            window <<= (at - length) & 7;
            size += (int32_t)(window >> (32 - length));
        }
        residual[i] = symbols[i] & 1 ? -size : size;
        present[i] = symbols[i] > 0;
    }
    return at;
}

/* Raw bits of residuals behind `bits`, most significant first, as `residuals_read` takes them, and
   symbols. Returns the number of bits; up to 3 bytes a residual and one more are written. */
long residuals_write(const int32_t *residual, const uint8_t *present, long n, uint8_t *symbols,
                     uint8_t *bits)
{
    enum { DIRECT_BITS = 4, DIRECT = 1 << DIRECT_BITS };
    uint64_t waiting = 0;
    long at = 0, held = 0;
    for (long i = 0; i < n; i++) {
        uint32_t size = (uint32_t)size_of(residual[i]), kind = size;
        if (size >= DIRECT) {
            int octave = DIRECT_BITS;
            while (size >> (octave + 1)) octave++;
            kind = DIRECT + 2 * (octave - DIRECT_BITS) + (size >> (octave - 1) & 1);
            waiting = waiting << (octave - 1) | (size & ((1u << (octave - 1)) - 1));
            at += octave - 1;
            for (held += octave - 1; held >= 8; held -= 8)
                *bits++ = (uint8_t)(waiting >> (held - 8));
        }
        symbols[i] = present[i] ? (uint8_t)(1 + 2 * kind - (residual[i] > 0)) : 0;
    }
    if (held) *bits = (uint8_t)(waiting << (8 - held));
    return at;
}

/* New columns of a pass that lie before column `end`. */
static long new_columns(long end, long spacing)
{
    return end > spacing / 2 ? (end - spacing / 2 - 1) / spacing + 1 : 0;
}

/* What `interlace.walk` asks about the cells of an image (columns, rings) and what they answer, one
   pass after the other; each pass' number of cells in `lengths`. `value`, `present` and `activity`
   (padded, rings) hold every `spacing`-th column; as many cells are scratch for `prediction`, and
   room for the other results. */
void interlace_record(const int32_t *image, const uint8_t *returns, long columns, long rings,
                      long spacing, long padded, int32_t *value, uint8_t *present,
                      int32_t *activity, int32_t *prediction, int32_t *context, int32_t *residual,
                      uint8_t *answered, int64_t *lengths)
{
    for (; spacing > 1; spacing /= 2)
        for (int odd = 0; odd < 2; odd++) {
            long asked = new_columns(columns, spacing), n = 0;
            ask(value, present, activity, padded, rings, spacing, odd, prediction, context);
            for (long column = spacing / 2; column < columns; column += spacing)
                for (long ring = odd; ring < rings; ring += 2, n++) {
                    long at = column * rings + ring;
                    int32_t rest = sum(less(image[at], prediction[n]), UNIT / 2) >> UNIT_BITS;
                    answered[n] = returns[at];
                    residual[n] = returns[at] ? rest : 0;
                }
            tell(value, present, activity, padded, rings, spacing, odd, asked, prediction, residual,
                 answered);
            context += n;
            residual += n;
            answered += n;
            *lengths++ = n;
        }
}

/* The image behind an entropy stream and raw bits: see `rans_take`, `residuals_read` and
   `interlace_record`. `at`: the next word and the next bit. Returns 0, or -1 where the stream and
   -2 where the raw bits end too early. Scratch as large as the padded image: `prediction`,
   `context`, `residual`, `answered`, `symbols`. */
long interlace_read(long columns, long rings, long spacing, long padded, int32_t *value,
                    uint8_t *present, int32_t *activity, int32_t *prediction, int32_t *context,
                    int32_t *residual, uint8_t *answered, uint8_t *symbols, const uint8_t *slots,
                    const uint32_t *frequencies, const uint32_t *starts, long width,
                    uint32_t *state, long lanes, const uint16_t *words, long end,
                    const int32_t *base, const int32_t *raw, const uint8_t *bits, long bits_end,
                    int64_t *at)
{
    for (; spacing > 1; spacing /= 2)
        for (int odd = 0; odd < 2; odd++) {
            long asked = new_columns(columns, spacing), n = asked * ((rings + 1 - odd) / 2);
            ask(value, present, activity, padded, rings, spacing, odd, prediction, context);
            at[0] = rans_take(context, n, slots, frequencies, starts, width, state, lanes, words,
                              at[0], end, symbols);
            if (at[0] < 0) return -1;
            at[1] = residuals_read(symbols, n, base, raw, bits, at[1], bits_end, residual, answered);
            if (at[1] < 0) return -2;
            tell(value, present, activity, padded, rings, spacing, odd, asked, prediction, residual,
                 answered);
        }
    return 0;
}

/* Positions (n, 3) of the cells of an image (columns, rings) that have a return, column by column;
   a value of 1 is unit_m metres. Directions as cosine and sine, (rings) and (columns). */
void cells_to_points(const int32_t *value, const uint8_t *present, long columns, long rings,
                     double unit_m, const double *cos_elevation, const double *sin_elevation,
                     const double *cos_azimuth, const double *sin_azimuth, float *points)
{
    for (long column = 0; column < columns; column++)
        for (long ring = 0; ring < rings; ring++, value++, present++) {
            if (!*present) continue;
            double range_m = *value * unit_m, flat = range_m * cos_elevation[ring];
            *points++ = (float)(flat * cos_azimuth[column]);
            *points++ = (float)(flat * sin_azimuth[column]);
            *points++ = (float)(range_m * sin_elevation[ring]);
        }
}
