// SPDX-License-Identifier: LGPL-3.0-or-later
//
// A particle meets a fictitious one, drawn from what the cloud does in its cell (Sommerfeld 2001).
//
//     u'    = R w' + sigma sqrt(1 - R^2) n,   w' the particle's own velocity about the mean,
//     R     = exp(-C (tau_p/T_L)^0.4)
//     p     = pi/4 (d_1 + d_2)^2 |w - u| n dt
//     w    -= m_2/(m_1 + m_2) [(1 + e) g_n + s g_t],   s = min(mu (1 + e) |g_n|/|g_t|, 2/7)
//     omega -= 5/(2 r_1) m_2/(m_1 + m_2) s n x g_t
//
// g is the slip of the points that touch, n the line of centres, from a place that is evenly
// distributed over the cross-section in which the two collide.
#pragma once

#include "gas.h"

namespace KERNEL_NAMESPACE {

using kernel::Job;

// eight particles in the frame of the part that is solved
struct Meeting {
    alignas(32) float w[3][8], omega[3][8];         // before
    alignas(32) float change[3][8], turn[3][8];     // of those that collide
    alignas(32) float frequency[8];                 // expected number of collisions a second
    alignas(32) float noise[3][8], chance[8], pick[4][8], shared[8];
};

// expected collisions a second of lane k with a material
inline double expected(const Job& job, const Meeting& m, int k, int32_t cell, double diameter, int material) {
    const float* row = job.partners.rows + ((int64_t)material * job.grid.count + cell) * kernel::PARTNER;
    double speed = 1e-12;
    for (int j = 0; j < 3; ++j) {
        const double slip = m.w[j][k] - row[1 + j];
        speed += slip * slip + (double)row[4 + j] * row[4 + j];
    }
    const double reach = diameter + row[7];
    return 0.7853981633974483 * reach * reach * __builtin_sqrt(speed) * row[0];
}

// A material of the cloud by its share of the collisions that are expected; that share. Draws from 0 to 1.
inline int partner(const Job& job, const Meeting& m, int k, int32_t cell, double diameter, float draw,
                   double& total, double& share) {
    const int count = job.partners.materials;
    total = 0;
    for (int i = 0; i < count; ++i) total += expected(job, m, k, cell, diameter, i);
    if (!(total > 0)) return -1;
    // the first whose sum reaches the draw
    int found = 0;
    double own = expected(job, m, k, cell, diameter, 0), sum = own;
    while (found < count - 1 && draw * total > sum) {
        own = expected(job, m, k, cell, diameter, ++found);
        sum += own;
    }
    share = own / total;
    return share > 0 ? found : -1;
}

// two unit vectors across a third
inline void across(const double e[3], double a[3], double b[3]) {
    int least = 0;
    for (int i = 1; i < 3; ++i)
        if (e[i] * e[i] < e[least] * e[least]) least = i;
    double size = 0;
    for (int i = 0; i < 3; ++i) a[i] = (i == least ? 1.0 : 0.0) - e[least] * e[i];
    for (int i = 0; i < 3; ++i) size += a[i] * a[i];
    size = 1 / __builtin_sqrt(size);
    for (int i = 0; i < 3; ++i) a[i] *= size;
    for (int i = 0; i < 3; ++i) b[i] = e[(i + 1) % 3] * a[(i + 2) % 3] - e[(i + 2) % 3] * a[(i + 1) % 3];
}

// what a collision with a partner at the slip g (own minus other) does to lane k
inline void collide_pair(const Job& job, Meeting& m, int k, const double g[3], double speed, double radius,
                         double heavier) {
    const kernel::Options& o = job.options;
    double e[3], a[3], b[3], n[3], slip[3];
    for (int i = 0; i < 3; ++i) e[i] = g[i] / speed;
    across(e, a, b);
    const double offset = __builtin_sqrt((double)m.pick[2][k]), turn = 6.283185307179586 * m.pick[3][k];
    const double ca = offset * __builtin_cos(turn), cb = offset * __builtin_sin(turn);
    const double ce = __builtin_sqrt(1 - offset * offset);
    double normal = 0;
    for (int i = 0; i < 3; ++i) {
        n[i] = ce * e[i] + ca * a[i] + cb * b[i];
        normal += g[i] * n[i];
    }
    double size = 1e-300;
    for (int i = 0; i < 3; ++i) {
        const int p = (i + 1) % 3, q = (i + 2) % 3;
        const double rolled = radius * (m.omega[p][k] * n[q] - m.omega[q][k] * n[p]);
        slip[i] = g[i] - normal * n[i] + rolled;
        size += slip[i] * slip[i];
    }
    const double push = (1 + o.pair_restitution) * normal;
    const double slide = o.pair_friction * push / __builtin_sqrt(size), s = slide < 2.0 / 7 ? slide : 2.0 / 7;
    for (int i = 0; i < 3; ++i) {
        const int p = (i + 1) % 3, q = (i + 2) % 3;
        m.change[i][k] = (float)(-heavier * (push * n[i] + s * slip[i]));
        m.turn[i][k] = (float)(-2.5 / radius * heavier * s * (n[p] * slip[q] - n[q] * slip[p]));
    }
}

// Whether lane k collides within dt. Fills the changes, and the frequency in any case.
inline bool meet_lane(const Job& job, Meeting& m, int k, int32_t cell, int material, double diameter,
                      double density, double dt) {
    const kernel::Partners& p = job.partners;
    m.frequency[k] = 0;
    if (!(diameter > 0)) return false;
    double total, share;
    const int other = partner(job, m, k, cell, diameter, m.pick[0][k], total, share);
    m.frequency[k] = (float)total;
    if (other < 0) return false;
    const float* row = p.rows + ((int64_t)other * job.grid.count + cell) * kernel::PARTNER;
    // only what is alike follows the same eddies
    const double r = other == material ? m.shared[k] : 0.0, rest = __builtin_sqrt(1 - r * r);
    double g[3], speed = 0;
    for (int i = 0; i < 3; ++i) {
        const double own = m.w[i][k], mean = row[1 + i];
        g[i] = own - (mean + r * (own - mean) + rest * row[4 + i] * m.noise[i][k]);
        speed += g[i] * g[i];
    }
    speed = __builtin_sqrt(speed);
    int at = (int)(m.pick[1][k] * kernel::PARTNER_SIZES);
    if (at >= kernel::PARTNER_SIZES) at = kernel::PARTNER_SIZES - 1;
    const double size = p.diameter[other * kernel::PARTNER_SIZES + at];
    const double reach = diameter + size;
    const double chance = 0.7853981633974483 * reach * reach * speed * row[0] * dt / share;
    if (!(m.chance[k] < chance) || !(speed > 1e-12)) return false;
    const double m1 = density * diameter * diameter * diameter, m2 = p.density[other] * size * size * size;
    collide_pair(job, m, k, g, speed, diameter / 2, m2 / (m1 + m2));
    return true;
}

}  // namespace KERNEL_NAMESPACE
