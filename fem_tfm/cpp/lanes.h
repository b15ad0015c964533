// SPDX-License-Identifier: LGPL-3.0-or-later
//
// Eight lanes side by side: floats, integers, doubles, and the few functions of them that a step needs.
//
// This file is compiled once for every instruction set, each time in its own namespace, and uses
// nothing of the standard library that could be linked across them.
#pragma once

#include <cstdint>
#if defined(__SSE2__)
#include <immintrin.h>
#endif

#define INLINE inline __attribute__((always_inline))

namespace KERNEL_NAMESPACE {

constexpr int LANES = 8;

using f4 = float __attribute__((vector_size(16)));
using f8 = float __attribute__((vector_size(32)));
using i8 = int32_t __attribute__((vector_size(32)));
using u8 = uint32_t __attribute__((vector_size(32)));
using d4 = double __attribute__((vector_size(32)));
using l4 = int64_t __attribute__((vector_size(32)));

#if defined(__clang__)
#define SHUFFLE(a, b, ...) __builtin_shufflevector(a, b, __VA_ARGS__)
#else
#define SHUFFLE(a, b, ...) __builtin_shuffle(a, b, i8{__VA_ARGS__})
#endif

// -- eight doubles as two halves ------------------------------------------------------------------

struct d8 {
    d4 a, b;
};

INLINE d8 operator+(d8 x, d8 y) { return {x.a + y.a, x.b + y.b}; }
INLINE d8 operator-(d8 x, d8 y) { return {x.a - y.a, x.b - y.b}; }
INLINE d8 operator*(d8 x, d8 y) { return {x.a * y.a, x.b * y.b}; }

INLINE f8 splat(float x) { return f8{x, x, x, x, x, x, x, x}; }
INLINE i8 splat_int(int32_t x) { return i8{x, x, x, x, x, x, x, x}; }
INLINE d8 splat_double(double x) { return {d4{x, x, x, x}, d4{x, x, x, x}}; }

INLINE f8 as_float(i8 x) { return (f8)x; }
INLINE i8 as_int(f8 x) { return (i8)x; }
INLINE f8 to_float(i8 x) { return __builtin_convertvector(x, f8); }
INLINE i8 truncated(f8 x) { return __builtin_convertvector(x, i8); }

// eight numbers that stand behind each other
template <class Eight>
INLINE Eight eight(const void* p) {
    Eight x;
    __builtin_memcpy(&x, p, sizeof x);
    return x;
}
INLINE f8 load(const float* p) { return eight<f8>(p); }
INLINE i8 load(const int32_t* p) { return eight<i8>(p); }
INLINE u8 load(const uint32_t* p) { return eight<u8>(p); }
INLINE d8 load(const double* p) { return eight<d8>(p); }
INLINE f4 load4(const float* p) {
    f4 x;
    __builtin_memcpy(&x, p, 16);
    return x;
}
INLINE void store(float* p, f8 x) { __builtin_memcpy(p, &x, 32); }
INLINE void store(int32_t* p, i8 x) { __builtin_memcpy(p, &x, 32); }
INLINE void store(uint32_t* p, u8 x) { __builtin_memcpy(p, &x, 32); }
INLINE void store(double* p, d8 x) { __builtin_memcpy(p, &x, 64); }

INLINE f8 to_float(d8 x) {
#if defined(__AVX__)
    return _mm256_set_m128(_mm256_cvtpd_ps((__m256d)x.b), _mm256_cvtpd_ps((__m256d)x.a));
#else
    f8 r;
    for (int k = 0; k < 4; ++k) r[k] = (float)x.a[k], r[k + 4] = (float)x.b[k];
    return r;
#endif
}
INLINE d8 to_double(f8 x) {
#if defined(__AVX__)
    return {(d4)_mm256_cvtps_pd(_mm256_castps256_ps128((__m256)x)),
            (d4)_mm256_cvtps_pd(_mm256_extractf128_ps((__m256)x, 1))};
#else
    d8 r;
    for (int k = 0; k < 4; ++k) r.a[k] = x[k], r.b[k] = x[k + 4];
    return r;
#endif
}

INLINE f8 select(i8 mask, f8 x, f8 y) { return mask ? x : y; }
INLINE i8 select(i8 mask, i8 x, i8 y) { return mask ? x : y; }
INLINE d8 select(i8 mask, d8 x, d8 y) {
    l4 a, b;
    for (int k = 0; k < 4; ++k) a[k] = mask[k], b[k] = mask[k + 4];
    return {a ? x.a : y.a, b ? x.b : y.b};
}
INLINE f8 smaller(f8 x, f8 y) { return x < y ? x : y; }
INLINE f8 larger(f8 x, f8 y) { return x > y ? x : y; }
INLINE f8 absolute(f8 x) { return as_float(as_int(x) & splat_int(0x7fffffff)); }
INLINE i8 narrowed(l4 a, l4 b) {
    const i8 low = (i8)a, high = (i8)b;
    return SHUFFLE(low, high, 0, 2, 4, 6, 8, 10, 12, 14);
}
INLINE i8 less(d8 x, d8 y) { return narrowed(x.a < y.a, x.b < y.b); }
INLINE d8 absolute(d8 x) {
    const l4 m = l4{INT64_MAX, INT64_MAX, INT64_MAX, INT64_MAX};
    return {(d4)((l4)x.a & m), (d4)((l4)x.b & m)};
}
// bit k is set where lane k of a mask is
INLINE unsigned bits(i8 mask) {
#if defined(__AVX__)
    return (unsigned)_mm256_movemask_ps((__m256)mask);
#else
    unsigned r = 0;
    for (int k = 0; k < LANES; ++k) r |= mask[k] ? 1u << k : 0u;
    return r;
#endif
}
INLINE f8 root(f8 x) {
#if defined(__AVX__)
    return (f8)_mm256_sqrt_ps((__m256)x);
#else
    f8 r;
    for (int k = 0; k < LANES; ++k) r[k] = __builtin_sqrtf(x[k]);
    return r;
#endif
}
// 1/sqrt(x), exact to round-off
INLINE f8 inverse_root(f8 x) { return 1.0f / root(x); }

// rows become columns
INLINE void transpose(f8 r[8]) {
    f8 a[8], b[8];
    for (int k = 0; k < 4; ++k) {
        a[2 * k] = SHUFFLE(r[2 * k], r[2 * k + 1], 0, 8, 1, 9, 4, 12, 5, 13);
        a[2 * k + 1] = SHUFFLE(r[2 * k], r[2 * k + 1], 2, 10, 3, 11, 6, 14, 7, 15);
    }
    for (int k = 0; k < 2; ++k) {
        const f8 *p = a + 4 * k;
        f8 *q = b + 4 * k;
        q[0] = SHUFFLE(p[0], p[2], 0, 1, 8, 9, 4, 5, 12, 13);
        q[1] = SHUFFLE(p[0], p[2], 2, 3, 10, 11, 6, 7, 14, 15);
        q[2] = SHUFFLE(p[1], p[3], 0, 1, 8, 9, 4, 5, 12, 13);
        q[3] = SHUFFLE(p[1], p[3], 2, 3, 10, 11, 6, 7, 14, 15);
    }
    for (int k = 0; k < 4; ++k) {
        r[k] = SHUFFLE(b[k], b[k + 4], 0, 1, 2, 3, 8, 9, 10, 11);
        r[k + 4] = SHUFFLE(b[k], b[k + 4], 4, 5, 6, 7, 12, 13, 14, 15);
    }
}

// -- functions, relative error about 1e-7 ----------------------------------------------------------

INLINE f8 nearest(f8 x) {
    const f8 magic = splat(12582912.0f);
    return (x + magic) - magic;
}

// e^x for x <= 0; zero below -87
INLINE f8 exponential(f8 x) {
    x = larger(x, splat(-87.0f));
    const f8 n = nearest(x * 1.44269504f);
    // ln 2 in two parts
    const f8 r = (x - n * 0.693145752f) - n * 1.42860677e-6f;
    f8 p = splat(1.0f / 5040);
    p = p * r + 1.0f / 720;
    p = p * r + 1.0f / 120;
    p = p * r + 1.0f / 24;
    p = p * r + 1.0f / 6;
    p = p * r + 0.5f;
    p = (p * r) * r + r;
    const f8 scale = as_float((truncated(n) + 127) << 23);
    return p * scale + scale;
}

// ln x for normal x > 0
INLINE f8 logarithm(f8 x) {
    i8 e = as_int(x) - 0x3f3504f3;
    e >>= 23;
    const f8 m = as_float(as_int(x) - (e << 23));
    const f8 t = (m - 1.0f) / (m + 1.0f), s = t * t;
    f8 p = splat(2.0f / 9);
    p = p * s + 2.0f / 7;
    p = p * s + 2.0f / 5;
    p = p * s + 2.0f / 3;
    p = (p * s) * t + 2.0f * t;
    return to_float(e) * 0.693147181f + p;
}

// sine and cosine of 2 pi u, |u| <= 1/2
INLINE void sine_cosine(f8 u, f8& sine, f8& cosine) {
    const f8 q = nearest(u * 4.0f);
    const i8 quarter = truncated(q);
    const f8 r = (u - q * 0.25f) * 6.28318531f, s = r * r;
    f8 a = splat(-1.0f / 5040);
    a = a * s + 1.0f / 120;
    a = a * s - 1.0f / 6;
    a = (a * s) * r + r;
    f8 b = splat(1.0f / 40320);
    b = b * s - 1.0f / 720;
    b = b * s + 1.0f / 24;
    b = (b * s - 0.5f) * s + 1.0f;
    const i8 swapped = (quarter & 1) != 0;
    f8 si = select(swapped, b, a), co = select(swapped, a, b);
    const i8 minus_sine = (quarter & 2) << 30;
    const i8 minus_cosine = ((quarter + 1) & 2) << 30;
    sine = as_float(as_int(si) ^ minus_sine);
    cosine = as_float(as_int(co) ^ minus_cosine);
}

// (1 - e^-h)/h and e^-h, h >= 0
INLINE f8 mean_decay(f8 h, f8& decay) {
    decay = exponential(-h);
    f8 p = splat(1.0f / 5040);
    p = p * h - 1.0f / 720;
    p = p * h + 1.0f / 120;
    p = p * h - 1.0f / 24;
    p = p * h + 1.0f / 6;
    p = p * h - 0.5f;
    p = p * h + 1.0f;
    return select(h < 0.4f, p, (1.0f - decay) / larger(h, splat(0.1f)));
}

// -- random numbers: Philox4x32-7 -------------------------------------------------------------------

struct Words {
    u8 w[4];
};

INLINE void multiply(u8 a, uint32_t b, u8& high, u8& low) {
#if defined(__AVX2__)
    const __m256i m = _mm256_set1_epi32((int)b), x = (__m256i)a;
    const __m256i even = _mm256_mul_epu32(x, m);
    const __m256i odd = _mm256_mul_epu32(_mm256_srli_epi64(x, 32), m);
    high = (u8)_mm256_blend_epi32(_mm256_srli_epi64(even, 32), odd, 0xAA);
#else
    for (int k = 0; k < LANES; ++k) high[k] = (uint32_t)(((uint64_t)a[k] * b) >> 32);
#endif
    low = a * b;
}

// counter (id, step, stream), key seed
INLINE Words philox(u8 low, u8 high, u8 step, uint32_t stream, uint64_t seed) {
    u8 c0 = low, c1 = high, c2 = step, c3 = (u8)splat_int((int32_t)stream);
    uint32_t k0 = (uint32_t)seed, k1 = (uint32_t)(seed >> 32);
    for (int round = 0; round < 7; ++round) {
        u8 h0, l0, h1, l1;
        multiply(c0, 0xD2511F53u, h0, l0);
        multiply(c2, 0xCD9E8D57u, h1, l1);
        c0 = h1 ^ c1 ^ k0;
        c1 = l1;
        c2 = h0 ^ c3 ^ k1;
        c3 = l0;
        k0 += 0x9E3779B9u;
        k1 += 0xBB67AE85u;
    }
    return {{c0, c1, c2, c3}};
}

// uniform in (0, 1) from the upper 23 bits of a word
INLINE f8 uniform(u8 w) {
    const f8 mantissa = as_float((i8)(w >> 9) | 0x3f800000);
    return mantissa - (1.0f - 5.9604645e-8f);
}

// three independent normal numbers, and a uniform one from bits that they leave
INLINE void normals(const Words& r, f8 n[3], f8& u) {
    const f8 low = splat(-2.0f);
    const f8 r0 = root(low * logarithm(uniform(r.w[0])));
    const f8 r1 = root(low * logarithm(uniform(r.w[1])));
    f8 s, c, s1, c1;
    sine_cosine(uniform(r.w[2]) - 0.5f, s, c);
    sine_cosine(uniform(r.w[3]) - 0.5f, s1, c1);
    n[0] = r0 * c;
    n[1] = r0 * s;
    n[2] = r1 * c1;
    const u8 rest = (r.w[0] << 24) | ((r.w[1] & 255u) << 16) | ((r.w[2] & 255u) << 8);
    u = uniform(rest);
}

}  // namespace KERNEL_NAMESPACE
