/* The layers of a network, inlined where they are used with their sizes known, so that compilers do them four at a time.
   That is also why tanh is written out: the library's takes one number at a time. */
#ifndef RIGTWIN_LAYER_H
#define RIGTWIN_LAYER_H

#include <math.h>
#include <stdint.h>
#include <string.h>

#define WIDEST 64 /* layer with tanh */

/* to (m) = bias + W x, m being 1 or whole fours; W (n, m) holds the weights of each input beside each other. A last layer, where large terms
   cancel, is summed in double. */
static inline void layer(int m, int n, const float *restrict W, const float *restrict bias,
                         const float *restrict x, float *restrict to)
{
    if (m == 1) {
        double sum = bias[0];
        for (int j = 0; j < n; j++)
            sum += (double)W[j] * x[j];
        to[0] = (float)sum;
        return;
    }
    for (int i = 0; i < m; i += 4) {
        float a = bias[i], b = bias[i + 1], c = bias[i + 2], d = bias[i + 3];
        for (int j = 0; j < n; j++) {
            const float *w = W + j * m + i;
            a += w[0] * x[j], b += w[1] * x[j], c += w[2] * x[j], d += w[3] * x[j];
        }
        to[i] = a, to[i + 1] = b, to[i + 2] = c, to[i + 3] = d;
    }
}

/* to (n) = tanh x = p / (p + 2) with p = e^2x - 1, to the last digit or so. With y = 2 x log2 e and m the whole number
   next to it, p = 2^m s + 2^m - 1, s the power series of 2^(y - m) - 1. */
static inline void tanh_of(int n, const float *x, float *to)
{
    static const float C[] = {1.52527338e-5f, 1.54035304e-4f, 1.33335581e-3f, 9.61812911e-3f,
                              5.55041087e-2f, 2.40226507e-1f, 6.93147181e-1f}; /* (log 2)^k / k!, k = 7 ... 1 */
    float fraction[WIDEST], power[WIDEST];
    int32_t bits[WIDEST];
    for (int i = 0; i < n; i++) {
        float y = 2.88539008f * x[i];
        y = y > 30 ? 30 : y < -30 ? -30 : y;
        const int32_t m = (int32_t)(y + (y < 0 ? -0.5f : 0.5f));
        fraction[i] = y - (float)m;
        bits[i] = (m + 127) * 8388608; /* 2^m as a float32 */
    }
    memcpy(power, bits, (size_t)n * sizeof *power);
    for (int i = 0; i < n; i++) {
        const float f = fraction[i];
        float sum = C[0];
        for (int k = 1; k < 7; k++)
            sum = sum * f + C[k];
        const float p = power[i] * (sum * f) + (power[i] - 1);
        to[i] = p / (p + 2);
    }
}

#endif
