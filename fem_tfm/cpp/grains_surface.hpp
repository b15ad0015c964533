// SPDX-License-Identifier: LGPL-3.0-or-later
// Distance of a point to a triangle. Included inside a namespace of one instruction set.
#pragma once

struct Nearest {
    double point[3], square;  // nearest point of the triangle, square of its distance
    bool inside;              // whether it is inside, not on an edge or a corner
};

static inline double dot3(const double* a, const double* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// Nearest point of the triangle with corners c[0..2], c[3..5], c[6..8] to p, by Voronoi regions.
static inline Nearest nearest(const double* c, const double* p) {
    double ab[3], ac[3], ap[3], bp[3], cp[3];
    for (int k = 0; k < 3; ++k) {
        ab[k] = c[3 + k] - c[k], ac[k] = c[6 + k] - c[k];
        ap[k] = p[k] - c[k], bp[k] = p[k] - c[3 + k], cp[k] = p[k] - c[6 + k];
    }
    const double d1 = dot3(ab, ap), d2 = dot3(ac, ap), d3 = dot3(ab, bp), d4 = dot3(ac, bp);
    const double d5 = dot3(ab, cp), d6 = dot3(ac, cp);
    const double va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2;
    double v, w;
    bool inside = false;
    if (d1 <= 0.0 && d2 <= 0.0) v = 0.0, w = 0.0;
    else if (d3 >= 0.0 && d4 <= d3) v = 1.0, w = 0.0;
    else if (d6 >= 0.0 && d5 <= d6) v = 0.0, w = 1.0;
    else if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) v = d1 / (d1 - d3), w = 0.0;
    else if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) v = 0.0, w = d2 / (d2 - d6);
    else if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) {
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6)), v = 1.0 - w;
    } else {
        const double by = 1.0 / (va + vb + vc);
        v = vb * by, w = vc * by, inside = true;
    }
    Nearest found{};
    for (int k = 0; k < 3; ++k) {
        found.point[k] = c[k] + v * ab[k] + w * ac[k];
        const double d = p[k] - found.point[k];
        found.square += d * d;
    }
    found.inside = inside;
    return found;
}
