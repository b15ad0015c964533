// SPDX-License-Identifier: LGPL-3.0-or-later
// Steps of grains: neighbour list, contacts, walls, motion. Compiled once per instruction set.
//
// One step of a block: (1) squares of distances of the listed pairs, those in contact are packed;
// (2) forces of the packed contacts, added to the block's grains and to the few behind its end;
// (3) walls and motion. A block's grains move as soon as all blocks before it have pushed them, so
// that one sweep over the grains is a step.
#include "grains_state.hpp"

#if defined(__AVX2__)
#include <immintrin.h>
#endif
#if defined(_OPENMP)
#include <omp.h>
#endif
#if defined(__linux__)
#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif

#ifndef GRAINS_SET
#define GRAINS_SET baseline
#endif

namespace fem_tfm::grains::GRAINS_SET {

#include "grains_arc.hpp"
#include "grains_lanes.hpp"
#include "grains_law.hpp"
#include "grains_surface.hpp"

namespace {

INLINE int least(int a, int b) { return a < b ? a : b; }
INLINE int most(int a, int b) { return a > b ? a : b; }
INLINE int blocks(const State& s) { return (s.n + BLOCK - 1) / BLOCK; }
INLINE int behind(const State& s, int b) { return least((b + 1) * BLOCK, s.n); }

// Numbers a grain is pushed with: force, n x F_t and, where grains roll with friction, the torque of
// that, each with a spare number.
template <bool ROLL>
constexpr int PUSH = ROLL ? 12 : 8;

// Room of one thread for one block.
struct Bench {
    double *push;  // (BLOCK + reach, PUSH)
    double *dx, *dy, *dz, *square, *sum;
    int *first, *second, *pair;
};

// -- contacts ---------------------------------------------------------------------------------------

// Note the pairs with springs that have come into contact, and forget the springs of those that have
// parted.
INLINE void note(State& s, int p, unsigned hit) {
    unsigned before = 0;
    for (int k = 0; k < W; ++k) before |= unsigned(s.touching[p + k] & 1) << k;
    if (before == hit) return;
    for (int k = 0; k < W; ++k) {
        s.touching[p + k] = (hit >> k) & 1 ? 255 : 0;
        if ((before & ~hit) >> k & 1) store_row(s.shear + 4 * p + 4 * k, row{});
    }
}

// Pack the pairs of a block that touch; returns how many.
template <int KIND>
INLINE int meet(State& s, int b, const Bench& t) {
    const row sign = {-1.0, -1.0, -1.0, 1.0};
    const double* __restrict x = s.x;
    const int *__restrict first = s.first, *__restrict second = s.second;
    double *__restrict to_x = t.dx, *__restrict to_y = t.dy, *__restrict to_z = t.dz;
    double *__restrict to_square = t.square, *__restrict to_sum = t.sum;
    int *__restrict to_first = t.first, *__restrict to_second = t.second, *__restrict to_pair = t.pair;
    std::ptrdiff_t found = 0;
    const std::ptrdiff_t base = std::ptrdiff_t(b) * s.room, end = base + s.pairs[b];
    for (std::ptrdiff_t p = base; p < end; p += W) {
        row r[W];
        for (int k = 0; k < W; ++k)
            r[k] = load_row(x + 4 * std::ptrdiff_t(second[p + k])) * sign +
                   load_row(x + 4 * std::ptrdiff_t(first[p + k]));
        column dx, dy, dz, sum;
        turn(r, dx, dy, dz, sum);
        const column square = dx * dx + dy * dy + dz * dz;
        const unsigned valid = end - p >= W ? (1u << W) - 1 : (1u << (end - p)) - 1;
        const unsigned hit = below(square, sum * sum) & valid;
        if constexpr (KIND != VISCOUS) {
            note(s, int(p), hit);
            int number[W];
            for (int k = 0; k < W; ++k) number[k] = int(p) + k;
            pack(to_pair + found, hit, number);
        }
        pack(to_x + found, hit, dx), pack(to_y + found, hit, dy), pack(to_z + found, hit, dz);
        pack(to_square + found, hit, square), pack(to_sum + found, hit, sum);
        pack(to_first + found, hit, first + p), pack(to_second + found, hit, second + p);
        found += __builtin_popcount(hit);
    }
    for (std::ptrdiff_t k = found; k < found + W; ++k) {
        to_first[k] = to_second[k] = b * BLOCK, to_pair[k] = int(base);
        to_x[k] = to_y[k] = to_z[k] = to_square[k] = to_sum[k] = 1.0;
    }
    return int(found);
}

INLINE void add(double* p, row r) { store_row(p, load_row(p) + r); }
INLINE void take(double* p, row r) { store_row(p, load_row(p) - r); }

// Reduced radius of packed contacts: r_i r_j/(r_i + r_j).
INLINE column reduced(const State& s, const Bench& t, int c, column sum) {
    column a, b;
    for (int k = 0; k < W; ++k) a[k] = s.x[4 * t.first[c + k] + 3], b[k] = s.x[4 * t.second[c + k] + 3];
    return a * b / sum;
}

// Rolling friction of packed contacts.
INLINE void roll_pairs(const State& s, const Bench& t, int c, int count, const Touch& touch,
                       column fn, column cr) {
    row r[W];
    for (int k = 0; k < W; ++k) {
        const int i = t.first[c + k], j = t.second[c + k];
        r[k] = load_row(s.v + 8 * i + 4) / s.x[4 * i + 3] - load_row(s.v + 8 * j + 4) / s.x[4 * j + 3];
    }
    column spin[4], torque[3];
    turn(r, spin[0], spin[1], spin[2], spin[3]);
    roll(s.pair, fn, touch.radius, cr, spin, torque);
    turn_back(torque[0], torque[1], torque[2], column{}, r);
    for (int k = 0; k < count; ++k) {
        add(t.push + PUSH<true> * t.first[c + k] + 8, r[k]);
        take(t.push + PUSH<true> * t.second[c + k] + 8, r[k]);
    }
}

// Forces of the packed contacts of a block. `t.push` is shifted by the caller: row of grain i.
template <int KIND, bool MONO, bool ROLL>
INLINE void collide(State& s, const Bench& t, int found) {
    constexpr std::ptrdiff_t SIZE = PUSH<ROLL>;
    const row sign = {-1.0, -1.0, -1.0, 1.0};
    const Law law = s.pair;
    const double* __restrict v = s.v;
    double *__restrict sheared = s.shear, *__restrict pushed = t.push;
    const double *__restrict at_x = t.dx, *__restrict at_y = t.dy, *__restrict at_z = t.dz;
    const double *__restrict at_square = t.square, *__restrict at_sum = t.sum;
    const int *__restrict first = t.first, *__restrict second = t.second, *__restrict pair = t.pair;
    const double dt = s.dt;
    Touch one{};
    one.inverse_mass = all(2.0 * v[3]), one.radius = all(0.5 * s.x[3]);
    const Stiff same = stiffness<KIND>(law, one);
    for (int c = 0; c < found; c += W) {
        Touch touch;
        row a[W], w[W];
        for (int k = 0; k < W; ++k) {
            const double* vi = v + 8 * std::ptrdiff_t(first[c + k]);
            const double* vj = v + 8 * std::ptrdiff_t(second[c + k]);
            a[k] = load_row(vj) * sign + load_row(vi);
            w[k] = load_row(vj + 4) + load_row(vi + 4);
        }
        column spare;
        turn(a, touch.dx, touch.dy, touch.dz, touch.inverse_mass);
        turn(w, touch.sx, touch.sy, touch.sz, spare);
        const column distance = root(load_column(at_square + c)), inverse = 1.0 / distance;
        touch.nx = load_column(at_x + c) * inverse, touch.ny = load_column(at_y + c) * inverse;
        touch.nz = load_column(at_z + c) * inverse;
        const column sum = load_column(at_sum + c);
        touch.overlap = sum - distance;
        touch.radius = one.radius;
        if constexpr (!MONO && (KIND == HERTZ || ROLL)) touch.radius = reduced(s, t, c, sum);
        const Stiff stiff = MONO && KIND != HERTZ ? same : stiffness<KIND>(law, touch);
        column shear[4];
        row h[W];
        if constexpr (KIND != VISCOUS) {
            for (int k = 0; k < W; ++k) h[k] = load_row(sheared + 4 * std::ptrdiff_t(pair[c + k]));
            turn(h, shear[0], shear[1], shear[2], shear[3]);
        }
        const Push f = push<KIND>(law, touch, stiff, shear, dt);
        turn_back(f.fx, f.fy, f.fz, column{}, a);
        turn_back(f.tx, f.ty, f.tz, column{}, w);
        if constexpr (KIND != VISCOUS) turn_back(shear[0], shear[1], shear[2], column{}, h);
        const auto give = [&](int k) {
            double* pi = pushed + SIZE * std::ptrdiff_t(first[c + k]);
            double* pj = pushed + SIZE * std::ptrdiff_t(second[c + k]);
            add(pi, a[k]), add(pi + 4, w[k]);
            take(pj, a[k]), add(pj + 4, w[k]);
            if constexpr (KIND != VISCOUS) store_row(sheared + 4 * std::ptrdiff_t(pair[c + k]), h[k]);
        };
        const int count = least(W, found - c);
        if (count == W)
            for (int k = 0; k < W; ++k) give(k);
        else
            for (int k = 0; k < count; ++k) give(k);
        if constexpr (ROLL) roll_pairs(s, t, c, count, touch, f.normal, stiff.cr);
    }
}

// All contacts of a block: its own grains' part stays in `t.push`, the rest goes to `spill`.
template <int KIND, bool MONO, bool ROLL>
__attribute__((noinline)) void contacts(State& s, int b, const Bench& t, std::int64_t& count) {
    const int own = behind(s, b) - b * BLOCK, reach = s.reach[b];
    constexpr int SIZE = PUSH<ROLL>;
    for (int k = 0; k < SIZE * (own + reach); k += 4) store_row(t.push + k, row{});
    Bench shifted = t;
    shifted.push = t.push - std::ptrdiff_t(SIZE) * b * BLOCK;
    const int found = meet<KIND>(s, b, shifted);
    collide<KIND, MONO, ROLL>(s, shifted, found);
    double* out = s.spill + std::ptrdiff_t(SIZE) * b * s.spill_room;
    for (int k = 0; k < SIZE * reach; k += 4) store_row(out + k, load_row(t.push + SIZE * own + k));
    count += found;
}

// -- walls and motion --------------------------------------------------------------------------------

// What walls do to W grains, summed.
struct Held {
    column f[3], t[3], m[3], normal;
};

template <int KIND, bool ROLL>
INLINE void press(State& s, int i, int slot, column overlap, column nx, column ny, column nz,
                  const column* v, const column* u, column radius, Held& sum) {
    const unsigned hit = below(column{}, overlap);
    double* memory = s.spring[slot] + std::ptrdiff_t(4) * i;
    std::uint8_t& pressed = s.pressed[SLOTS * i + slot];
    if (!hit) {
        if (KIND != VISCOUS && pressed)
            for (int k = 0; k < W; ++k) store_row(memory + 4 * k, row{});
        pressed = 0;
        return;
    }
    pressed = 1;
    Touch touch{overlap, nx, ny, nz, v[0], v[1], v[2], u[0], u[1], u[2], v[3], radius};
    const Stiff stiff = stiffness<KIND>(s.wall, touch);
    column shear[4];
    row h[W];
    if constexpr (KIND != VISCOUS) {
        for (int k = 0; k < W; ++k) h[k] = load_row(memory + 4 * k);
        turn(h, shear[0], shear[1], shear[2], shear[3]);
    }
    const Push f = push<KIND>(s.wall, touch, stiff, shear, s.dt);
    const column none{};
    if constexpr (KIND != VISCOUS) {
        for (int k = 0; k < 3; ++k) shear[k] = where(hit, shear[k], none);
        turn_back(shear[0], shear[1], shear[2], none, h);
        for (int k = 0; k < W; ++k) store_row(memory + 4 * k, h[k]);
    }
    const column parts[7] = {f.fx, f.fy, f.fz, f.tx, f.ty, f.tz, f.normal};
    for (int k = 0; k < 3; ++k) {
        sum.f[k] += where(hit, parts[k], none);
        sum.t[k] += where(hit, parts[3 + k], none);
    }
    sum.normal += where(hit, f.normal, none);
    if constexpr (ROLL) {
        const column spin[3] = {u[0] / radius, u[1] / radius, u[2] / radius};
        column torque[3];
        roll(s.wall, f.normal, radius, stiff.cr, spin, torque);
        for (int k = 0; k < 3; ++k) sum.m[k] += where(hit, torque[k], none);
    }
}

// Note which of W grains touch the wall of a slot, and log those that did not in the step before. Held
// grains make no impact.
INLINE void watch(State& s, int i, int slot, column overlap, const column* normal, const column* x,
                  const column* v, const column* u) {
    const unsigned hit = below(column{}, overlap);
    unsigned before = 0;
    for (int k = 0; k < W; ++k) before |= unsigned(s.marks[i + k] >> slot & 1) << k;
    if (hit == before) return;
    for (int k = 0; k < W && i + k < s.n; ++k) {
        const unsigned now = hit >> k & 1, was = before >> k & 1;
        s.marks[i + k] = std::uint8_t((s.marks[i + k] & ~(1u << slot)) | now << slot);
        if (!now || was || !(u[3][k] > 0.0)) continue;
        double row[IMPACT] = {}, square = 0.0;
        for (int d = 0; d < 3; ++d) {
            row[d] = x[d][k] - (x[3][k] - overlap[k]) * normal[d][k];
            row[4] -= v[d][k] * normal[d][k], square += v[d][k] * v[d][k];
        }
        if (!(row[4] > 0.0)) continue;
        row[3] = __builtin_sqrt(square), row[5] = 1.0 / v[3][k], row[6] = x[3][k], row[7] = double(s.id[i + k]);
        log_impact(s, i / BLOCK, row);
    }
}

// Overlap of W grains with the wall of a bent round tube, and the normal into it. The axis has turned
// by an angle with this cosine and sine; what lies before and behind the arc is straight.
INLINE column bent(const State& s, const column* x, column* normal) {
    const Arc& a = s.arc;
    const column one = all(1.0), none{}, tiny = all(1e-300);
    const column c = x[0] * a.normal[0] + x[1] * a.normal[1];
    const column lever = a.radius - c, ahead = x[2] - a.before;
    const column size = root(lever * lever + ahead * ahead + tiny);
    const unsigned first = below(ahead, none) & below(none, lever);
    const unsigned last = below(none, ahead * a.cosine - lever * a.sine) &
                          below(none, lever * a.cosine + ahead * a.sine);
    const column cosine = where(last, all(a.cosine), where(first, one, lever / size));
    const column sine = where(last, all(a.sine), where(first, none, ahead / size));
    const column towards = a.radius - (lever * cosine + ahead * sine);
    // from the axis
    const column across = towards * cosine - c;
    normal[0] = x[0] + across * a.normal[0], normal[1] = x[1] + across * a.normal[1];
    normal[2] = -towards * sine;
    const column rho = root(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2] + tiny);
    const column by = -1.0 / rho;
    for (int k = 0; k < 3; ++k) normal[k] *= by;
    return rho + x[3] - s.walls.radius;
}

template <int KIND, bool ROLL>
INLINE void press_side(State& s, int i, int slot, column overlap, const column* normal, const column* x,
                       const column* v, const column* u, Held& sum) {
    if (s.watching) watch(s, i, slot, overlap, normal, x, v, u);
    press<KIND, ROLL>(s, i, slot, overlap, normal[0], normal[1], normal[2], v, u, x[3], sum);
}

template <int KIND, bool ROLL>
INLINE void press_all(State& s, int i, const column* x, const column* v, const column* u, Held& sum) {
    const Walls& w = s.walls;
    const column none{}, one = all(1.0), r = x[3];
    if (w.kind == ROUND) {
        const column rho = root(x[0] * x[0] + x[1] * x[1] + all(1e-300)), by = -1.0 / rho;
        const column normal[3] = {x[0] * by, x[1] * by, none};
        press_side<KIND, ROLL>(s, i, 0, rho + r - w.radius, normal, x, v, u, sum);
    } else if (w.kind == BENT) {
        column normal[3];
        const column overlap = bent(s, x, normal);
        press_side<KIND, ROLL>(s, i, 0, overlap, normal, x, v, u, sum);
    } else if (w.kind == RECTANGULAR) {
        const unsigned left = below(x[0], none), down = below(x[1], none);
        const column nx = where(left, one, -one), ny = where(down, one, -one);
        const column across[3] = {nx, none, none}, up[3] = {none, ny, none};
        press_side<KIND, ROLL>(s, i, 0, r - w.half_width - nx * x[0], across, x, v, u, sum);
        press_side<KIND, ROLL>(s, i, 1, r - w.half_height - ny * x[1], up, x, v, u, sum);
    }
    if (w.low_closed || w.high_closed) {
        column overlap = -one, nz = one;
        if (w.low_closed) {
            overlap = w.low + r - x[2];
            // the last leg of a bend that turns back lies behind the plane of the inlet
            if (w.kind == BENT)
                overlap = where(below(x[0] * s.arc.normal[0] + x[1] * s.arc.normal[1], all(s.arc.radius)),
                                overlap, -one);
        }
        if (w.high_closed) {
            const column upper = x[2] + r - w.high;
            const unsigned high = below(overlap, upper);
            overlap = where(high, upper, overlap), nz = where(high, -one, one);
        }
        // held grains come through the lower wall
        const unsigned moves = below(none, u[3]);
        overlap = where(moves, overlap, -one);
        press<KIND, ROLL>(s, i, 2, overlap, none, none, nz, v, u, r, sum);
    }
}

// Points at which a grain touches the surface, the deepest first; returns how many. A triangle that is
// touched at its rim counts where no deeper triangle has that point, so that a smooth surface pushes
// once.
INLINE int touch_surface(const State& s, int i, double overlap[SLOTS], double normal[SLOTS][3]) {
    const double *x = s.x + 4 * i, r = x[3];
    Nearest kept[SLOTS];
    int triangle[SLOTS], count = 0;
    for (int n = s.near_begin[i]; n < s.near_begin[i + 1]; ++n) {
        Nearest found = nearest(s.corner + 9 * s.near[n], x);
        if (!(found.square < r * r) || found.square == 0.0) continue;
        int at = count;
        while (at > 0 && (found.square < kept[at - 1].square)) --at;
        if (at == SLOTS) continue;
        for (int k = least(count, SLOTS - 1); k > at; --k) kept[k] = kept[k - 1], triangle[k] = triangle[k - 1];
        kept[at] = found, triangle[at] = s.near[n];
        count = least(count + 1, SLOTS);
    }
    int used = 0, by[SLOTS];
    for (int k = 0; k < count; ++k) {
        bool anew = true;
        for (int q = 0; q < used && !kept[k].inside; ++q)
            anew = anew && nearest(s.corner + 9 * triangle[by[q]], kept[k].point).square > 1e-12 * r * r;
        if (!anew) continue;
        const double distance = __builtin_sqrt(kept[k].square);
        overlap[used] = r - distance;
        for (int d = 0; d < 3; ++d) normal[used][d] = (x[d] - kept[k].point[d]) / distance;
        by[used++] = k;
    }
    return used;
}

template <int KIND, bool ROLL>
INLINE void press_surface(State& s, int i, const column* x, const column* v, const column* u, Held& sum) {
    column overlap[SLOTS], normal[SLOTS][3];
    for (int k = 0; k < SLOTS; ++k) {
        overlap[k] = all(-1.0);
        for (int d = 0; d < 3; ++d) normal[k][d] = column{};
    }
    for (int k = 0; k < W && i + k < s.n; ++k) {
        double deep[SLOTS], way[SLOTS][3];
        const int count = touch_surface(s, i + k, deep, way);
        for (int c = 0; c < count; ++c) {
            overlap[c][k] = deep[c];
            for (int d = 0; d < 3; ++d) normal[c][d][k] = way[c][d];
        }
    }
    for (int c = 0; c < SLOTS; ++c)
        press_side<KIND, ROLL>(s, i, c, overlap[c], normal[c], x, v, u, sum);
}

// Contact forces of W grains from i on: the block's own, and what blocks before have pushed.
template <bool ROLL>
INLINE void gather(const State& s, int b, int i, const double* own, column* f, column* t, column* m) {
    constexpr int SIZE = PUSH<ROLL>;
    row a[W], c[W], e[W];
    for (int k = 0; k < W; ++k) {
        const double* p = own + SIZE * (i - b * BLOCK + k);
        a[k] = load_row(p), c[k] = load_row(p + 4);
        if constexpr (ROLL) e[k] = load_row(p + 8);
    }
    for (int before = b - 1; before >= 0; --before) {
        const int end = (before + 1) * BLOCK, reach = s.reach[before];
        if (end + s.spill_room <= b * BLOCK) break;
        const double* p = s.spill + SIZE * (std::ptrdiff_t(before) * s.spill_room + i - end);
        for (int k = 0; k < W && i + k < end + reach; ++k) {
            a[k] += load_row(p + SIZE * k), c[k] += load_row(p + SIZE * k + 4);
            if constexpr (ROLL) e[k] += load_row(p + SIZE * k + 8);
        }
    }
    turn(a, f[0], f[1], f[2], f[3]);
    turn(c, t[0], t[1], t[2], t[3]);
    if constexpr (ROLL) turn(e, m[0], m[1], m[2], m[3]);
}

template <int KIND, bool ROLL>
INLINE column move_some(State& s, int b, int i, const double* own) {
    row a[W], c[W], e[W];
    column x[4], v[4], u[4], f[4], t[4], m[4], drive[4];
    for (int k = 0; k < W; ++k) {
        a[k] = load_row(s.x + 4 * (i + k)), e[k] = load_row(s.force + 4 * (i + k));
    }
    turn(a, x[0], x[1], x[2], x[3]), turn(e, drive[0], drive[1], drive[2], drive[3]);
    for (int k = 0; k < W; ++k)
        a[k] = load_row(s.v + 8 * (i + k)), c[k] = load_row(s.v + 8 * (i + k) + 4);
    turn(a, v[0], v[1], v[2], v[3]), turn(c, u[0], u[1], u[2], u[3]);
    gather<ROLL>(s, b, i, own, f, t, m);
    Held held{};
    if (s.triangles) press_surface<KIND, ROLL>(s, i, x, v, u, held);
    else press_all<KIND, ROLL>(s, i, x, v, u, held);
    if (s.recording)
        for (int k = 0; k < W && i + k < s.n; ++k) {
            double* r = s.record + 8 * (i + k);
            for (int d = 0; d < 3; ++d) r[d] = held.f[d][k], r[4 + d] = f[d][k];
            r[3] = held.normal[k];
        }
    const column none{}, dt = all(s.dt), inverse = u[3];
    const unsigned free = below(none, inverse);
    for (int k = 0; k < 3; ++k) {
        const column pull = where(free, all(s.gravity[k]), none);
        v[k] += dt * ((f[k] + held.f[k] + drive[k]) * inverse + pull);
        column turned = t[k] + held.t[k];
        if constexpr (ROLL) turned += (m[k] + held.m[k]) / x[3];
        u[k] += (2.5 * dt) * inverse * turned;
        x[k] += dt * v[k];
    }
    const unsigned out = below(all(s.release), x[2]);
    u[3] = where(out, v[3], u[3]);
    turn_back(x[0], x[1], x[2], x[3], a);
    for (int k = 0; k < W; ++k) store_row(s.x + 4 * (i + k), a[k]);
    turn_back(v[0], v[1], v[2], v[3], a), turn_back(u[0], u[1], u[2], u[3], c);
    for (int k = 0; k < W; ++k) store_row(s.v + 8 * (i + k), a[k]), store_row(s.v + 8 * (i + k) + 4, c[k]);
    return v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
}

// Walls and motion of a block; returns the square of its largest speed.
template <int KIND, bool ROLL>
__attribute__((noinline)) double move(State& s, int b, const double* own) {
    column top{};
    const int end = behind(s, b);
    for (int i = b * BLOCK; i < end; i += W) {
        const column square = move_some<KIND, ROLL>(s, b, i, own);
        const unsigned valid = end - i >= W ? (1u << W) - 1 : (1u << (end - i)) - 1;
        // a comparison that a speed without a number passes too
        top = where(valid & ~below(square, top), square, top);
    }
    double largest = 0.0;
    for (int k = 0; k < W; ++k)
        if (!(top[k] <= largest)) largest = top[k];
    return largest;
}

#include "grains_list.hpp"
#include "grains_sweep.hpp"

}  // namespace

void run(State& s, int steps) { start(s, steps); }

// Shares of the threads for a list that was made before.
void share(State& s) { share_out(s, s.rolling ? PUSH<true> : PUSH<false>); }

}  // namespace fem_tfm::grains::GRAINS_SET
