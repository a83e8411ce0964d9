/* The same networks as plain loops, as one would write them by hand in C.
 *
 * d += F·w - κx - ζd, x += d: the CA scheme in delta form (Kontogeorgakopoulos & Cadoz 2007).
 * Compiled with -O3 -march=native -ffp-contract=off: as fast as the machine goes without other bits. */
#include <stdint.h>

/* Sum by eight lanes: one accumulator would wait for itself and hide what the loop costs. */
static double sum(int64_t n, const double *restrict x) {
    double lane[8] = {0};
    int64_t i = 0;
    for (; i + 8 <= n; i += 8)
        for (int j = 0; j < 8; j++)
            lane[j] += x[i + j];
    double rest = 0;
    for (; i < n; i++)
        rest += x[i];
    return rest + ((lane[0] + lane[4]) + (lane[2] + lane[6])) +
           ((lane[1] + lane[5]) + (lane[3] + lane[7]));
}

/* n isolated oscillators, listened to as a sum: out (n_frames). */
void bank(int64_t n_frames, int64_t n, const double *restrict kappa, const double *restrict zeta,
          double *restrict x, double *restrict d, double *restrict out) {
    for (int64_t frame = 0; frame < n_frames; frame++) {
        out[frame] = sum(n, x);
        for (int64_t i = 0; i < n; i++) {
            d[i] -= kappa[i] * x[i] + zeta[i] * d[i];
            x[i] += d[i];
        }
    }
}

/* Masses of one kind (w: 0 for a fixed point), moved by the forces summed before. */
static void masses(int64_t n, const double *restrict w, const double *restrict force,
                   double *restrict x, double *restrict d) {
    for (int64_t i = 0; i < n; i++) {
        d[i] += force[i] * w[i];
        x[i] += d[i];
    }
}

/* A network as a list of links a[i], b[i], all with f = k·e + q·e³ + z·(e - e⁻).
 * Listened to at `taps`: out (n_frames, n_taps). */
void list(int64_t n_frames, int64_t n, int64_t n_lia, const int32_t *restrict a,
          const int32_t *restrict b, double k, double q, double z, const double *restrict w,
          double *restrict x, double *restrict d, double *restrict force, int64_t n_taps,
          const int32_t *restrict taps, double *restrict out) {
    for (int64_t frame = 0; frame < n_frames; frame++) {
        for (int64_t i = 0; i < n; i++)
            force[i] = 0;
        for (int64_t i = 0; i < n_lia; i++) {
            double e = x[b[i]] - x[a[i]];
            double f = k * e + q * (e * e * e) + z * (d[b[i]] - d[a[i]]);
            force[a[i]] += f;
            force[b[i]] -= f;
        }
        for (int64_t i = 0; i < n_taps; i++)
            out[frame * n_taps + i] = x[taps[i]];
        masses(n, w, force, x, d);
    }
}

/* The same network when its links are known to lie in runs: a + j, b + j for j < len. */
void runs(int64_t n_frames, int64_t n, int64_t n_runs, const int32_t *restrict a,
          const int32_t *restrict b, const int32_t *restrict len, double k, double q, double z,
          const double *restrict w, double *restrict x, double *restrict d,
          double *restrict force, double *restrict f, int64_t n_taps,
          const int32_t *restrict taps, double *restrict out) {
    for (int64_t frame = 0; frame < n_frames; frame++) {
        for (int64_t i = 0; i < n; i++)
            force[i] = 0;
        for (int64_t run = 0; run < n_runs; run++) {
            const double *xa = x + a[run], *xb = x + b[run], *da = d + a[run], *db = d + b[run];
            double *fa = force + a[run], *fb = force + b[run];
            for (int64_t j = 0; j < len[run]; j++) {
                double e = xb[j] - xa[j];
                f[j] = k * e + q * (e * e * e) + z * (db[j] - da[j]);
            }
            for (int64_t j = 0; j < len[run]; j++)
                fa[j] += f[j];
            for (int64_t j = 0; j < len[run]; j++)
                fb[j] -= f[j];
        }
        for (int64_t i = 0; i < n_taps; i++)
            out[frame * n_taps + i] = x[taps[i]];
        masses(n, w, force, x, d);
    }
}
