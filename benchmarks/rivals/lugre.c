/* The scheme of frictionjax/simulation/ros2.py for LuGre alone, written by hand: the speed limit of this processor.

   LANES drives go side by side through the vector units; the exponential is a polynomial. */
#include <math.h>
#include <stddef.h>
#include <stdint.h>

#ifndef LANES
#define LANES 64
#endif

static inline double exponential(double x) { /* for x <= 0 */
  const double log2e = 1.4426950408889634, high = 0.693147180369123816490, low = 1.90821492927058770002e-10;
  x = x < -700.0 ? -700.0 : x;
  double n = __builtin_floor(x * log2e + 0.5);
  double r = (x - n * high) - n * low;
  double p = 1.0 / 6227020800.0;
  p = p * r + 1.0 / 479001600.0;
  p = p * r + 1.0 / 39916800.0;
  p = p * r + 1.0 / 3628800.0;
  p = p * r + 1.0 / 362880.0;
  p = p * r + 1.0 / 40320.0;
  p = p * r + 1.0 / 5040.0;
  p = p * r + 1.0 / 720.0;
  p = p * r + 1.0 / 120.0;
  p = p * r + 1.0 / 24.0;
  p = p * r + 1.0 / 6.0;
  p = p * r + 0.5;
  p = p * r + 1.0;
  p = p * r + 1.0;
  union {
    int64_t bits;
    double value;
  } scale;
  scale.bits = ((int64_t)n + 1023) << 52;
  return p * scale.value;
}

/* parameters: J, sigma0, sigma1, sigma2, Fc, Fs, vs, each `drives` long (a multiple of LANES); force: `samples` long.
   out: the `drives` last positions, or with `all` (samples, drives) positions; `substeps` steps a sample of dt s. */
void simulate(int drives, int samples, int substeps, const double *parameters, const double *force, double dt,
              double *out, int all) {
  const double gamma = 1.0 - 0.70710678118654752440, h = dt / substeps, gh = gamma * h;
#pragma omp parallel for schedule(static)
  for (int first = 0; first < drives; first += LANES) {
    double x[LANES], v[LANES], z[LANES], mobility[LANES], s0[LANES], s1[LANES], s2[LANES], Fc[LANES], drop[LANES];
    double per_vs[LANES], bound[LANES];
    for (int i = 0; i < LANES; i++) {
      const double *p = parameters + first + i;
      x[i] = v[i] = z[i] = 0.0;
      mobility[i] = 1.0 / p[0];
      s0[i] = p[(size_t)drives];
      s1[i] = p[2 * (size_t)drives];
      s2[i] = p[3 * (size_t)drives];
      Fc[i] = p[4 * (size_t)drives];
      drop[i] = p[5 * (size_t)drives] - Fc[i];
      per_vs[i] = 1.0 / p[6 * (size_t)drives];
      bound[i] = 2.5 * p[5 * (size_t)drives] / s0[i];
    }
    for (int k = 0; k < samples; k++) {
      if (all || k == samples - 1)
        for (int i = 0; i < LANES; i++) out[(all ? (size_t)k * drives : 0) + first + i] = x[i];
      for (int part = 0; part < substeps; part++) {
#pragma omp simd
        for (int i = 0; i < LANES; i++) {
          double r = v[i] * per_vs[i], bell = drop[i] * exponential(-r * r), soft = 1.0 / (Fc[i] + bell);
          double slope_level = -2.0 * r * per_vs[i] * bell;
          double spring = s0[i] * z[i], bend = spring * soft, rate = v[i] - fabs(v[i]) * bend;
          double friction = spring + s1[i] * rate + s2[i] * v[i];
          double ahead = v[i] + h * (force[k] - friction) * mobility[i];
          int turns = (ahead + v[i]) * v[i] < 0.0;
          double fast = turns ? ahead : v[i], slip = fabs(fast) * soft, rate_z = -slip * s0[i];
          double side = fast > 0.0 ? bend : (fast < 0.0 ? -bend : 0.0);
          double rate_v = 1.0 - side + slip * bend * (turns ? 0.0 : slope_level);
          double below_z = 1.0 - gh * rate_z, coupling = -gh * mobility[i] * (s0[i] + s1[i] * rate_z);
          double below_v = 1.0 + gh * (s2[i] + s1[i] * rate_v) * mobility[i];
          double pivot_z = 1.0 / below_z, pivot_v = below_z / (below_z * below_v - gh * coupling * rate_v);
          double arm = coupling * pivot_z, a = (force[k] - friction) * mobility[i];
          double k1v = (a + arm * rate) * pivot_v, k1z = (rate + gh * rate_v * k1v) * pivot_z, k1x = v[i] + gh * k1v;
          double v1 = v[i] + h * k1v, z1 = z[i] + h * k1z, r1 = v1 * per_vs[i];
          double rate1 = v1 - fabs(v1) * s0[i] * z1 / (Fc[i] + drop[i] * exponential(-r1 * r1));
          double friction1 = s0[i] * z1 + s1[i] * rate1 + s2[i] * v1;
          double a1 = (force[k] - friction1) * mobility[i] - 2.0 * k1v, b1 = rate1 - 2.0 * k1z;
          double k2v = (a1 + arm * b1) * pivot_v, k2z = (b1 + gh * rate_v * k2v) * pivot_z;
          double k2x = v1 - 2.0 * k1x + gh * k2v, z2 = z[i] + h * (1.5 * k1z + 0.5 * k2z);
          double within = fmin(fmax(z2, -bound[i]), bound[i]);
          x[i] += h * (1.5 * k1x + 0.5 * k2x);
          v[i] += h * (1.5 * k1v + 0.5 * k2v) + s1[i] * (z2 - within) * mobility[i];
          z[i] = within;
        }
      }
    }
  }
}
