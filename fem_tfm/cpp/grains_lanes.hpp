// SPDX-License-Identifier: LGPL-3.0-or-later
// Lanes of doubles: eight with AVX-512, else four, and rows of four doubles turned into columns.
//
// Included by grains_step.cpp alone, inside its namespace of one instruction set.
#pragma once

#define INLINE inline __attribute__((always_inline))

#if defined(__AVX512F__) && defined(__AVX512VL__) && defined(__AVX512DQ__)
#define GRAINS_WIDE 1
constexpr int W = 8;
#else
constexpr int W = 4;
#endif

// a row of four doubles, and a column of W of them; one instruction each where the machine has it
using row = double __attribute__((vector_size(32)));
using column = double __attribute__((vector_size(8 * W)));
using flags = std::int64_t __attribute__((vector_size(8 * W)));

INLINE column all(double a) { return a - column{}; }
INLINE row load_row(const double* p) {
    row r;
    __builtin_memcpy(&r, p, 32);
    return r;
}
INLINE void store_row(double* p, row r) { __builtin_memcpy(p, &r, 32); }
INLINE column load_column(const double* p) {
    column c;
    __builtin_memcpy(&c, p, 8 * W);
    return c;
}
INLINE void store_column(double* p, column c) { __builtin_memcpy(p, &c, 8 * W); }

#if defined(GRAINS_WIDE)

INLINE column root(column a) { return (column)_mm512_sqrt_pd((__m512d)a); }
INLINE column smaller(column a, column b) { return (column)_mm512_min_pd((__m512d)a, (__m512d)b); }
INLINE column larger(column a, column b) { return (column)_mm512_max_pd((__m512d)a, (__m512d)b); }
// bits of the lanes where a < b
INLINE unsigned below(column a, column b) {
    return _mm512_cmp_pd_mask((__m512d)a, (__m512d)b, _CMP_LT_OQ);
}
INLINE column where(unsigned bits, column a, column b) {
    return (column)_mm512_mask_blend_pd((__mmask8)bits, (__m512d)b, (__m512d)a);
}

INLINE void turn(const row* r, column& a, column& b, column& c, column& d) {
    const auto pair = [&](int k) {
        return _mm512_insertf64x4(_mm512_castpd256_pd512((__m256d)r[k]), (__m256d)r[k + 4], 1);
    };
    const __m512d p0 = pair(0), p1 = pair(1), p2 = pair(2), p3 = pair(3);
    const __m512d l01 = _mm512_unpacklo_pd(p0, p1), h01 = _mm512_unpackhi_pd(p0, p1);
    const __m512d l23 = _mm512_unpacklo_pd(p2, p3), h23 = _mm512_unpackhi_pd(p2, p3);
    const __m512i even = _mm512_setr_epi64(0, 1, 8, 9, 4, 5, 12, 13);
    const __m512i odd = _mm512_setr_epi64(2, 3, 10, 11, 6, 7, 14, 15);
    a = (column)_mm512_permutex2var_pd(l01, even, l23);
    b = (column)_mm512_permutex2var_pd(h01, even, h23);
    c = (column)_mm512_permutex2var_pd(l01, odd, l23);
    d = (column)_mm512_permutex2var_pd(h01, odd, h23);
}

INLINE void turn_back(column a, column b, column c, column d, row* r) {
    const __m512d l0 = _mm512_unpacklo_pd((__m512d)a, (__m512d)b);
    const __m512d h0 = _mm512_unpackhi_pd((__m512d)a, (__m512d)b);
    const __m512d l1 = _mm512_unpacklo_pd((__m512d)c, (__m512d)d);
    const __m512d h1 = _mm512_unpackhi_pd((__m512d)c, (__m512d)d);
    const __m512i even = _mm512_setr_epi64(0, 1, 8, 9, 4, 5, 12, 13);
    const __m512i odd = _mm512_setr_epi64(2, 3, 10, 11, 6, 7, 14, 15);
    const __m512d p0 = _mm512_permutex2var_pd(l0, even, l1), p2 = _mm512_permutex2var_pd(l0, odd, l1);
    const __m512d p1 = _mm512_permutex2var_pd(h0, even, h1), p3 = _mm512_permutex2var_pd(h0, odd, h1);
    const auto split = [&](int k, __m512d p) {
        r[k] = (row)_mm512_castpd512_pd256(p);
        r[k + 4] = (row)_mm512_extractf64x4_pd(p, 1);
    };
    split(0, p0), split(1, p1), split(2, p2), split(3, p3);
}

// store the lanes of the bits one behind the other
INLINE void pack(double* p, unsigned bits, column a) {
    store_column(p, (column)_mm512_maskz_compress_pd((__mmask8)bits, (__m512d)a));
}
INLINE void pack(int* p, unsigned bits, const int* from) {
    const __m256i a = _mm256_loadu_si256((const __m256i*)from);
    _mm256_storeu_si256((__m256i*)p, _mm256_maskz_compress_epi32((__mmask8)bits, a));
}

#else

#if defined(__AVX2__)
INLINE column root(column a) { return (column)_mm256_sqrt_pd((__m256d)a); }
INLINE column smaller(column a, column b) { return (column)_mm256_min_pd((__m256d)a, (__m256d)b); }
INLINE column larger(column a, column b) { return (column)_mm256_max_pd((__m256d)a, (__m256d)b); }
INLINE unsigned below(column a, column b) {
    return (unsigned)_mm256_movemask_pd(_mm256_cmp_pd((__m256d)a, (__m256d)b, _CMP_LT_OQ));
}
#else
INLINE column root(column a) {
    for (int k = 0; k < W; ++k) a[k] = __builtin_sqrt(a[k]);
    return a;
}
INLINE column smaller(column a, column b) { return a < b ? a : b; }
INLINE column larger(column a, column b) { return a > b ? a : b; }
INLINE unsigned below(column a, column b) {
    unsigned bits = 0;
    for (int k = 0; k < W; ++k) bits |= unsigned(a[k] < b[k]) << k;
    return bits;
}
#endif

INLINE column where(unsigned bits, column a, column b) {
    const flags lane = {1, 2, 4, 8};
    return (lane & std::int64_t(bits)) != 0 ? a : b;
}

#if defined(__clang__)
#define GRAINS_SHUFFLE(a, b, i, j, k, l) __builtin_shufflevector(a, b, i, j, k, l)
#else
#define GRAINS_SHUFFLE(a, b, i, j, k, l) __builtin_shuffle(a, b, flags{i, j, k, l})
#endif

INLINE void turn(const row* r, column& a, column& b, column& c, column& d) {
    const row l01 = GRAINS_SHUFFLE(r[0], r[1], 0, 4, 2, 6), h01 = GRAINS_SHUFFLE(r[0], r[1], 1, 5, 3, 7);
    const row l23 = GRAINS_SHUFFLE(r[2], r[3], 0, 4, 2, 6), h23 = GRAINS_SHUFFLE(r[2], r[3], 1, 5, 3, 7);
    a = GRAINS_SHUFFLE(l01, l23, 0, 1, 4, 5), c = GRAINS_SHUFFLE(l01, l23, 2, 3, 6, 7);
    b = GRAINS_SHUFFLE(h01, h23, 0, 1, 4, 5), d = GRAINS_SHUFFLE(h01, h23, 2, 3, 6, 7);
}

INLINE void turn_back(column a, column b, column c, column d, row* r) {
    const column rows[4] = {a, b, c, d};
    turn(rows, r[0], r[1], r[2], r[3]);
}

INLINE void pack(double* p, unsigned bits, column a) {
    for (int k = 0, at = 0; k < W; ++k) p[at] = a[k], at += (bits >> k) & 1;
}
INLINE void pack(int* p, unsigned bits, const int* from) {
    for (int k = 0, at = 0; k < W; ++k) p[at] = from[k], at += (bits >> k) & 1;
}

#endif
