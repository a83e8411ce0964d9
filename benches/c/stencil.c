/* One string and one mesh as loops that know their network by heart: nothing but these runs in them.
 *
 * x⁺ = 2x - x⁻ + (a + b)·Lx - b·Lx⁻, L the sum over neighbours of the difference to them, a = k/m·T²
 * and b = z/m·T. Three buffers take turns, so that every value is read once a frame and written once;
 * n_frames is a multiple of three, and then each buffer ends as what it began: now, before, next. */
#include <stdint.h>

/* A string of n masses between held ends, (n + 2) a buffer. Listened to at `taps` (0: the held end):
 * out (n_frames, n_taps). */
void string(int64_t n_frames, int64_t n, double a, double b, double *now, double *before,
            double *next, int64_t n_taps, const int32_t *taps, double *restrict out) {
    for (int64_t frame = 0; frame < n_frames; frame++) {
        const double *restrict x = now, *restrict was = before;
        double *restrict to = next;
        for (int64_t i = 0; i < n_taps; i++)
            *out++ = x[taps[i]];
        for (int64_t i = 1; i <= n; i++) {
            double bend = x[i - 1] + x[i + 1] - 2 * x[i];
            double bent = was[i - 1] + was[i + 1] - 2 * was[i];
            to[i] = 2 * x[i] - was[i] + ((a + b) * bend - b * bent);
        }
        double *old = before;
        before = now, now = next, next = old;
    }
}

/* A square mesh of side² masses within a held rim, (side + 2)² a buffer, and a hammer under its point
 * `struck`: a mass that pushes by p·push on itself, p·lift on the point, while p, what it is above the point,
 * is positive. hammer: where it is, where it was. */
void mesh(int64_t n_frames, int64_t side, double a, double b, double *now, double *before,
          double *next, double *hammer, int64_t struck, double push, double lift, int64_t n_taps,
          const int32_t *taps, double *restrict out) {
    int64_t wide = side + 2;
    for (int64_t frame = 0; frame < n_frames; frame++) {
        const double *restrict x = now, *restrict was = before;
        double *restrict to = next;
        for (int64_t i = 0; i < n_taps; i++)
            *out++ = x[taps[i]];
        for (int64_t r = 1; r <= side; r++)
            for (int64_t i = r * wide + 1; i <= r * wide + side; i++) {
                double bend = (x[i - 1] + x[i + 1]) + (x[i - wide] + x[i + wide]) - 4 * x[i];
                double bent = (was[i - 1] + was[i + 1]) + (was[i - wide] + was[i + wide]) - 4 * was[i];
                to[i] = 2 * x[i] - was[i] + ((a + b) * bend - b * bent);
            }
        double p = hammer[0] > x[struck] ? hammer[0] - x[struck] : 0;
        to[struck] += lift * p;
        double then = 2 * hammer[0] - hammer[1] - push * p;
        hammer[1] = hammer[0], hammer[0] = then;
        double *old = before;
        before = now, now = next, next = old;
    }
}
