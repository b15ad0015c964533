// SPDX-License-Identifier: LGPL-3.0-or-later
// A tube with an arc in its axis. Included inside a namespace of one instruction set.
#pragma once

// Coordinates (x, y, s) of a point in the straight line, as fem_tfm/geometry/arc.py has them.
static inline void straighten(const Arc& a, const double* x, double* out) {
    const double c = x[0] * a.normal[0] + x[1] * a.normal[1];
    const double lever = a.radius - c, ahead = x[2] - a.before;
    const double behind = ahead * a.cosine - lever * a.sine, past = lever * a.cosine + ahead * a.sine;
    double cosine = 1.0, sine = 0.0, along = x[2];
    if (behind > 0.0 && past > 0.0) {
        cosine = a.cosine, sine = a.sine, along = a.before + a.radius * a.angle + behind;
    } else if (ahead > 0.0 || lever <= 0.0) {
        const double size = __builtin_sqrt(lever * lever + ahead * ahead);
        cosine = lever / size, sine = ahead / size;
        along = a.before + a.radius * __builtin_atan2(ahead, lever);
    }
    const double shift = a.radius - (lever * cosine + ahead * sine) - c;
    out[0] = x[0] + shift * a.normal[0], out[1] = x[1] + shift * a.normal[1], out[2] = along;
}

// Place along the axis.
static inline double place_along(const State& s, const double* x) {
    if (s.walls.kind != BENT) return x[2];
    double straight[3];
    straighten(s.arc, x, straight);
    return straight[2];
}
