/* Springs in space as plain loops: points with three coordinates, links along distances, gravity.
 *
 * f = k·(ℓ - rest) + z·n·(d_b - d_a) along n; d += F·w, x += d. Compiled as networks.c. */
#include <math.h>
#include <stdint.h>
#include <string.h>

/* As one writes it: points (n, 3), a list of links. Heard: one number of x, out (n_frames). */
void matter_list(int64_t n_frames, int64_t n, int64_t n_lia, const int32_t *restrict a,
                 const int32_t *restrict b, const double *restrict k, const double *restrict rest,
                 double z, const double *restrict w, const double *restrict weight,
                 double *restrict x, double *restrict d, double *restrict force, int64_t tap,
                 double *restrict out) {
    for (int64_t frame = 0; frame < n_frames; frame++) {
        memcpy(force, weight, 3 * n * sizeof(double));
        for (int64_t i = 0; i < n_lia; i++) {
            const double *xa = x + 3 * a[i], *xb = x + 3 * b[i];
            const double *da = d + 3 * a[i], *db = d + 3 * b[i];
            double ex = xb[0] - xa[0], ey = xb[1] - xa[1], ez = xb[2] - xa[2];
            double length = sqrt(ex * ex + ey * ey + ez * ez);
            double inverse = 1.0 / length;
            ex *= inverse, ey *= inverse, ez *= inverse;
            double step = ex * (db[0] - da[0]) + ey * (db[1] - da[1]) + ez * (db[2] - da[2]);
            double f = k[i] * (length - rest[i]) + z * step;
            double *fa = force + 3 * a[i], *fb = force + 3 * b[i];
            fa[0] += f * ex, fa[1] += f * ey, fa[2] += f * ez;
            fb[0] -= f * ex, fb[1] -= f * ey, fb[2] -= f * ez;
        }
        out[frame] = x[tap];
        for (int64_t i = 0; i < 3 * n; i++) {
            d[i] += force[i] * w[i];
            x[i] += d[i];
        }
    }
}

/* Written for vectors: coordinates axis by axis, runs of links whose ends advance together. */
void matter_runs(int64_t n_frames, int64_t n, int64_t n_runs, const int32_t *restrict a,
                 const int32_t *restrict b, const int32_t *restrict len, const double *restrict k,
                 const double *restrict rest, double z, const double *restrict w,
                 const double *restrict weight, double *restrict x, double *restrict d,
                 double *restrict force, double *restrict room, int64_t tap,
                 double *restrict out) {
    double *px = room, *py = room + n, *pz = room + 2 * n;
    for (int64_t frame = 0; frame < n_frames; frame++) {
        memcpy(force, weight, 3 * n * sizeof(double));
        for (int64_t run = 0; run < n_runs; run++) {
            const double *xa = x + a[run], *xb = x + b[run];
            const double *da = d + a[run], *db = d + b[run];
            for (int64_t i = 0; i < len[run]; i++) {
                double ex = xb[i] - xa[i], ey = xb[i + n] - xa[i + n];
                double ez = xb[i + 2 * n] - xa[i + 2 * n];
                double length = sqrt(ex * ex + ey * ey + ez * ez);
                double inverse = 1.0 / length;
                ex *= inverse, ey *= inverse, ez *= inverse;
                double step = ex * (db[i] - da[i]) + ey * (db[i + n] - da[i + n]) +
                              ez * (db[i + 2 * n] - da[i + 2 * n]);
                double f = k[run] * (length - rest[run]) + z * step;
                px[i] = f * ex, py[i] = f * ey, pz[i] = f * ez;
            }
            for (int axis = 0; axis < 3; axis++) {
                double *fa = force + a[run] + axis * n, *fb = force + b[run] + axis * n;
                const double *p = room + axis * n;
                for (int64_t i = 0; i < len[run]; i++)
                    fa[i] += p[i];
                for (int64_t i = 0; i < len[run]; i++)
                    fb[i] -= p[i];
            }
        }
        out[frame] = x[tap];
        for (int64_t i = 0; i < 3 * n; i++) {
            d[i] += force[i] * w[i];
            x[i] += d[i];
        }
    }
}
