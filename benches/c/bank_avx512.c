/* The bank as one would tune it for one processor: 64 lanes, 256 samples at a time.
 *
 * Eight vectors are in flight, since one oscillator's next sample waits for its last; the sum over
 * lanes stays a vector through the whole block and is reduced once, after the last oscillator.
 * n must be a multiple of 64 (lanes that hold zeros stay zero). Absent where there is no AVX-512. */
#include <stdint.h>

#ifdef __AVX512F__
#include <immintrin.h>

enum { LANES = 64, VECTORS = LANES / 8, BLOCK = 256 };

/* 64 oscillators through one block; what they sum to is added to `sums`. */
static inline void lanes(int64_t n_frames, const double *kappa, const double *keep, double *x,
                         double *d, __m512d *restrict sums) {
    __m512d X[VECTORS], D[VECTORS], K[VECTORS], R[VECTORS];
#pragma GCC unroll 8
    for (int v = 0; v < VECTORS; v++) {
        X[v] = _mm512_loadu_pd(x + 8 * v);
        D[v] = _mm512_loadu_pd(d + 8 * v);
        K[v] = _mm512_loadu_pd(kappa + 8 * v);
        R[v] = _mm512_loadu_pd(keep + 8 * v);
    }
    for (int64_t frame = 0; frame < n_frames; frame++) {
        __m512d half = _mm512_add_pd(_mm512_add_pd(X[0], X[1]), _mm512_add_pd(X[2], X[3]));
        __m512d rest = _mm512_add_pd(_mm512_add_pd(X[4], X[5]), _mm512_add_pd(X[6], X[7]));
        sums[frame] = _mm512_add_pd(sums[frame], _mm512_add_pd(half, rest));
#pragma GCC unroll 8
        for (int v = 0; v < VECTORS; v++) {
            D[v] = _mm512_fnmadd_pd(K[v], X[v], _mm512_mul_pd(R[v], D[v]));
            X[v] = _mm512_add_pd(X[v], D[v]);
        }
    }
#pragma GCC unroll 8
    for (int v = 0; v < VECTORS; v++) {
        _mm512_storeu_pd(x + 8 * v, X[v]);
        _mm512_storeu_pd(d + 8 * v, D[v]);
    }
}

/* n isolated oscillators, d = keep·d - kappa·x, x += d, listened to as a sum: out (n_frames). */
void bank_avx512(int64_t n_frames, int64_t n, const double *restrict kappa,
                 const double *restrict keep, double *restrict x, double *restrict d,
                 double *restrict out) {
    static __m512d sums[BLOCK];
    for (int64_t begin = 0; begin < n_frames; begin += BLOCK) {
        int64_t len = n_frames - begin < BLOCK ? n_frames - begin : BLOCK;
        for (int64_t frame = 0; frame < len; frame++)
            sums[frame] = _mm512_setzero_pd();
        for (int64_t i = 0; i < n; i += LANES)
            lanes(len, kappa + i, keep + i, x + i, d + i, sums);
        for (int64_t frame = 0; frame < len; frame++)
            out[begin + frame] = _mm512_reduce_add_pd(sums[frame]);
    }
}
#endif
