/* Grains in a drum as plain loops: lists of neighbours with a skin, found by cells. Compiled as networks.c.
 *
 * f = k·(ℓ - gap) + z·n·(d_j - d_i) along n while ℓ < gap; the drum is a sphere around 0. Points are (n, 3). */
#include <math.h>
#include <stdint.h>
#include <string.h>

static int64_t neighbours(int64_t n, double reach, double radius, int64_t side,
                          const double *restrict x, int32_t *restrict heads,
                          int32_t *restrict next, int32_t *restrict starts,
                          int32_t *restrict others) {
    int64_t count = 0;
    for (int64_t i = 0; i < side * side * side; i++)
        heads[i] = -1;
    for (int64_t i = n - 1; i >= 0; i--) {
        int64_t cell = 0;
        for (int axis = 0; axis < 3; axis++)
            cell = cell * side + 1 + (int64_t)((x[3 * i + axis] + radius) / reach);
        next[i] = heads[cell];
        heads[cell] = (int32_t)i;
    }
    for (int64_t i = 0; i < n; i++) {
        starts[i] = (int32_t)count;
        int64_t at[3];
        for (int axis = 0; axis < 3; axis++)
            at[axis] = 1 + (int64_t)((x[3 * i + axis] + radius) / reach);
        for (int64_t u = at[0] - 1; u <= at[0] + 1; u++)
            for (int64_t v = at[1] - 1; v <= at[1] + 1; v++)
                for (int64_t w = at[2] - 1; w <= at[2] + 1; w++)
                    for (int32_t j = heads[(u * side + v) * side + w]; j >= 0; j = next[j]) {
                        double ex = x[3 * j] - x[3 * i], ey = x[3 * j + 1] - x[3 * i + 1];
                        double ez = x[3 * j + 2] - x[3 * i + 2];
                        if (j > i && ex * ex + ey * ey + ez * ez <= reach * reach)
                            others[count++] = j;
                    }
    }
    starts[n] = (int32_t)count;
    return count;
}

/* `side` cells each way hold the drum; heard: one number of x, out (n_frames). */
void grains(int64_t n_frames, int64_t n, double gap, double skin, double k, double z,
            double radius, double wall, double w, double weight, int64_t side,
            double *restrict x, double *restrict d, double *restrict force,
            double *restrict from, int32_t *restrict heads, int32_t *restrict next,
            int32_t *restrict starts, int32_t *restrict others, int64_t tap,
            double *restrict out) {
    double most = 0.25 * skin * skin, room = radius + gap;
    memset(from, 0x7f, 3 * n * sizeof(double)); /* far away: the first list is made */
    for (int64_t frame = 0; frame < n_frames; frame++) {
        int moved = 0;
        for (int64_t i = 0; i < n; i++) {
            double ex = x[3 * i] - from[3 * i], ey = x[3 * i + 1] - from[3 * i + 1];
            double ez = x[3 * i + 2] - from[3 * i + 2];
            moved |= ex * ex + ey * ey + ez * ez > most;
        }
        if (moved) {
            memcpy(from, x, 3 * n * sizeof(double));
            neighbours(n, gap + skin, room, side, x, heads, next, starts, others);
        }
        for (int64_t i = 0; i < n; i++) {
            force[3 * i] = force[3 * i + 1] = 0.0;
            force[3 * i + 2] = weight;
        }
        for (int64_t i = 0; i < n; i++) {
            const double *xi = x + 3 * i, *di = d + 3 * i;
            double fx = 0.0, fy = 0.0, fz = 0.0;
            for (int32_t at = starts[i]; at < starts[i + 1]; at++) {
                int64_t j = others[at];
                const double *xj = x + 3 * j, *dj = d + 3 * j;
                double ex = xj[0] - xi[0], ey = xj[1] - xi[1], ez = xj[2] - xi[2];
                double square = ex * ex + ey * ey + ez * ez;
                if (square >= gap * gap)
                    continue;
                double length = sqrt(square), inverse = 1.0 / length;
                ex *= inverse, ey *= inverse, ez *= inverse;
                double step = ex * (dj[0] - di[0]) + ey * (dj[1] - di[1]) + ez * (dj[2] - di[2]);
                double f = k * (length - gap) + z * step;
                fx += f * ex, fy += f * ey, fz += f * ez;
                force[3 * j] -= f * ex, force[3 * j + 1] -= f * ey, force[3 * j + 2] -= f * ez;
            }
            double far = xi[0] * xi[0] + xi[1] * xi[1] + xi[2] * xi[2];
            if (far > radius * radius) {
                double length = sqrt(far), f = -wall * (length - radius) / length;
                fx += f * xi[0], fy += f * xi[1], fz += f * xi[2];
            }
            force[3 * i] += fx, force[3 * i + 1] += fy, force[3 * i + 2] += fz;
        }
        out[frame] = x[tap];
        for (int64_t i = 0; i < 3 * n; i++) {
            d[i] += force[i] * w;
            x[i] += d[i];
        }
    }
}
