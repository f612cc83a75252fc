/* The entropy coder's loops: see perception/codec/rans.py, whose streams these write and read, bit
   for bit. */

#include <stdint.h>

enum { PRECISION = 12, TOTAL = 1 << PRECISION };
static const uint32_t LOW = 1u << 16;

/* One run of `n` symbols, from its end, onto the lanes' states. Words are written downwards from
   `words + at`; returns where the last one lies. */
long rans_put(const int32_t *contexts, const uint8_t *symbols, long n, const uint32_t *frequencies,
              const uint32_t *starts, long width, uint32_t *state, long lanes, uint16_t *words,
              long at)
{
    for (long begin = n > 0 ? (n - 1) / lanes * lanes : -1; begin >= 0; begin -= lanes)
        for (long lane = (n - begin < lanes ? n - begin : lanes) - 1; lane >= 0; lane--) {
            long cell = contexts[begin + lane] * width + symbols[begin + lane];
            uint32_t frequency = frequencies[cell], x = state[lane];
            if (x >= (uint64_t)frequency << (32 - PRECISION)) {
                words[--at] = (uint16_t)x;
                x >>= 16;
            }
            state[lane] = x / frequency * (TOTAL - frequency) + x + starts[cell];
        }
    return at;
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
