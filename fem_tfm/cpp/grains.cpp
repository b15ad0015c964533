// SPDX-License-Identifier: LGPL-3.0-or-later
#include "grains.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <new>
#include <stdexcept>
#include <string>
#include <utility>

namespace fem_tfm::grains {

namespace baseline {
void run(State& s, int steps);
void share(State& s);
}
#if defined(GRAINS_AVX2)
namespace avx2 {
void run(State& s, int steps);
}
namespace avx512 {
void run(State& s, int steps);
}
#endif

namespace {

template <class T>
void grow(T*& p, std::size_t before, std::size_t after) {
    const std::size_t bytes = (std::max<std::size_t>(after, 1) * sizeof(T) + 63) / 64 * 64;
    T* fresh = static_cast<T*>(std::aligned_alloc(64, bytes));
    if (!fresh) throw std::bad_alloc();
    std::memset(static_cast<void*>(fresh), 0, bytes);
    if (p) std::memcpy(static_cast<void*>(fresh), p, std::min(before, after) * sizeof(T));
    std::free(p);
    p = fresh;
}

template <class T>
void renew(T*& p, std::size_t count) {
    std::free(p);
    p = nullptr;
    grow(p, 0, count);
}

#include "grains_arc.hpp"
#include "grains_surface.hpp"

int block_count(int n) { return (n + BLOCK - 1) / BLOCK; }

struct Choice {
    const char* name;
    Run run;
};

std::vector<Choice> choices() {
    std::vector<Choice> found;
#if defined(GRAINS_AVX2)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
        __builtin_cpu_supports("avx512dq"))
        found.push_back({"avx512", avx512::run});
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        found.push_back({"avx2", avx2::run});
#endif
    found.push_back({"baseline", baseline::run});
    return found;
}

Choice& choice() {
    static Choice chosen = choices().front();
    return chosen;
}

}  // namespace

std::vector<const char*> instruction_sets() {
    std::vector<const char*> names;
    for (const Choice& one : choices()) names.push_back(one.name);
    return names;
}

void use(const char* name) {
    for (const Choice& one : choices())
        if (std::string(one.name) == name) {
            choice() = one;
            return;
        }
    throw std::invalid_argument(std::string("no instruction set ") + name);
}

const char* used() { return choice().name; }

// -- memory ------------------------------------------------------------------------------------------

void reserve_pairs(State& s, int room) {
    const int count = block_count(s.capacity);
    const std::size_t total = std::size_t(count) * room + PAD;
    // lists are made anew after this, what is kept of the old one stays
    const std::size_t old = std::max(s.kept_count, 0);
    renew(s.first, total), renew(s.second, total);
    grow(s.kept, 2 * old, 2 * total), grow(s.kept_shear, 4 * old, 4 * total);
    renew(s.shear, 4 * total), renew(s.touching, total);
    s.room = room;
}

void reserve_spill(State& s, int room) {
    renew(s.spill, std::size_t(12) * block_count(s.capacity) * room);
    s.spill_room = room;
}

void reserve_slabs(State& s, int room) {
    renew(s.slab, room);
    s.slab_room = room;
}

void reserve_benches(State& s, std::size_t pushes, int pairs) {
    if (pushes <= s.bench_pushes && pairs <= s.bench_pairs) return;
    s.bench_pushes = std::max(pushes, s.bench_pushes), s.bench_pairs = std::max(pairs + pairs / 4, s.bench_pairs);
    for (int t = 0; t < s.threads; ++t)
        renew(s.bench[t], s.bench_pushes + 7 * std::size_t(s.bench_pairs) + PAD);
}

void log_impact(State& s, int block, const double* row) {
    Log& log = s.log[block];
    if (log.count == log.room) {
        log.room = 2 * log.room + 16;
        log.row = static_cast<double*>(std::realloc(log.row, sizeof(double) * IMPACT * log.room));
        if (!log.row) throw std::bad_alloc();
    }
    std::memcpy(log.row + std::size_t(IMPACT) * log.count++, row, sizeof(double) * IMPACT);
}

// Boxes of space, each with the triangles that a grain in it may touch.
struct Boxes {
    double low[3], size;
    int count[3];
    std::vector<int> begin, triangle;

    int of(const double* x) const {
        int at[3];
        for (int k = 0; k < 3; ++k) {
            const double c = (x[k] - low[k]) / size;
            if (!(c >= 0.0) || c >= count[k]) return -1;
            at[k] = int(c);
        }
        return (at[2] * count[1] + at[1]) * count[0] + at[0];
    }
};

namespace {

// Boxes as large as the reach or more, at most some millions.
Boxes boxes(const State& s, double reach) {
    Boxes b{};
    double high[3];
    for (int k = 0; k < 3; ++k) {
        b.low[k] = HUGE_VAL, high[k] = -HUGE_VAL;
        for (int c = 0; c < 3 * s.triangles; ++c) {
            b.low[k] = std::min(b.low[k], s.corner[3 * c + k]);
            high[k] = std::max(high[k], s.corner[3 * c + k]);
        }
        b.low[k] -= reach, high[k] += reach;
    }
    const double volume = (high[0] - b.low[0]) * (high[1] - b.low[1]) * (high[2] - b.low[2]);
    b.size = std::max(2.0 * reach, std::cbrt(volume / 2e6));
    for (int k = 0; k < 3; ++k) b.count[k] = int((high[k] - b.low[k]) / b.size) + 1;
    const std::size_t total = std::size_t(b.count[0]) * b.count[1] * b.count[2];
    std::vector<std::vector<int>> found(total);
    for (int t = 0; t < s.triangles; ++t) {
        int from[3], to[3];
        for (int k = 0; k < 3; ++k) {
            const double* c = s.corner + 9 * t + k;
            const double least = std::min({c[0], c[3], c[6]}), most = std::max({c[0], c[3], c[6]});
            from[k] = std::max(int((least - reach - b.low[k]) / b.size), 0);
            to[k] = std::min(int((most + reach - b.low[k]) / b.size), b.count[k] - 1);
        }
        for (int z = from[2]; z <= to[2]; ++z)
            for (int y = from[1]; y <= to[1]; ++y)
                for (int x = from[0]; x <= to[0]; ++x) found[(z * b.count[1] + y) * b.count[0] + x].push_back(t);
    }
    for (const auto& one : found) {
        b.begin.push_back(int(b.triangle.size()));
        b.triangle.insert(b.triangle.end(), one.begin(), one.end());
    }
    b.begin.push_back(int(b.triangle.size()));
    return b;
}

}  // namespace

void list_surface(State& s) {
    const double reach = s.largest + 0.5 * s.skin;
    if (!s.boxes || s.boxes_reach != reach) {
        delete s.boxes;
        s.boxes = new Boxes(boxes(s, reach)), s.boxes_reach = reach;
    }
    const Boxes& b = *s.boxes;
    std::vector<int> near;
    for (int i = 0; i < s.n; ++i) {
        s.near_begin[i] = int(near.size());
        const double *x = s.origin + 4 * i, most = x[3] + 0.5 * s.skin;
        const int box = b.of(x);
        for (int k = box < 0 ? 0 : b.begin[box]; box >= 0 && k < b.begin[box + 1]; ++k)
            if (nearest(s.corner + 9 * b.triangle[k], x).square < most * most) near.push_back(b.triangle[k]);
    }
    s.near_begin[s.n] = int(near.size());
    renew(s.near, near.size());
    std::copy(near.begin(), near.end(), s.near);
}

std::vector<double> Grains::take_impacts() {
    std::vector<double> found;
    for (int b = 0; b < block_count(s.capacity); ++b) {
        Log& log = s.log[b];
        found.insert(found.end(), log.row, log.row + std::size_t(IMPACT) * log.count);
        log.count = 0;
    }
    return found;
}

void Grains::set_arc(const double* normal, double radius, double angle, double before) {
    refresh();
    Arc& a = s.arc;
    a = {{normal[0], normal[1]}, radius, angle, before, std::cos(angle), std::sin(angle), 1.0};
    stretch();
}

// Largest distance along the axis over the reach of two grains within it, both on the inner side.
void Grains::stretch() {
    const double reach = 2.0 * s.largest + s.skin, least = s.arc.radius - s.walls.radius;
    if (s.walls.kind != BENT || reach <= 0.0) return;
    const double half = least > 0.5 * reach ? std::asin(0.5 * reach / least) : 0.5 * std::acos(-1.0);
    s.arc.stretch = 2.0 * s.arc.radius * half / reach;
}

void Grains::set_surface(int count, const double* corners) {
    refresh();
    corners_.assign(corners, corners + 9 * std::size_t(count));
    s.triangles = count, s.corner = corners_.data();
    delete s.boxes;
    s.boxes = nullptr;
}

Grains::Grains() {
    s.room = 8 * BLOCK, s.kept_count = 0, s.mono = 1;
    s.release = HUGE_VAL;
    reserve(BLOCK);
    set_threads(1);
}

Grains::~Grains() {
    for (double* p : {s.x, s.v, s.force, s.record, s.origin, s.straight, s.spare, s.column, s.shear, s.spill,
                      s.kept_shear, s.speed})
        std::free(p);
    for (int* p : {s.cell, s.order, s.first, s.second, s.begin, s.amount, s.pairs, s.reach, s.slab, s.kept,
                   s.cut, s.late})
        std::free(p);
    for (int t = 0; t < s.threads; ++t) std::free(s.bench[t]);
    std::free(s.bench), std::free(s.id), std::free(s.touching), std::free(s.pressed);
    std::free(s.near_begin), std::free(s.near), std::free(s.marks);
    for (int b = 0; b < block_count(s.capacity); ++b) std::free(s.log[b].row);
    std::free(s.log);
    for (double* spring : s.spring) std::free(spring);
    delete s.boxes;
}

void Grains::reserve(int n) {
    if (n <= s.capacity) return;
    const int size = block_count(n + n / 4) * BLOCK;
    const std::size_t now = s.n, then = size + PAD;
    grow(s.x, 4 * now, 4 * then), grow(s.v, 8 * now, 8 * then), grow(s.force, 4 * now, 4 * then);
    for (double*& spring : s.spring) grow(spring, 4 * now, 4 * then);
    grow(s.record, 8 * now, 8 * then);
    grow(s.origin, 4 * now, 4 * then), grow(s.id, now, then), grow(s.marks, now, then);
    renew(s.straight, 4 * then), grow(s.log, block_count(s.capacity), block_count(size));
    renew(s.pressed, SLOTS * then);
    renew(s.spare, 12 * then), renew(s.column, 4 * then), renew(s.cell, then), renew(s.order, then);
    renew(s.begin, then), renew(s.amount, then), renew(s.near_begin, then);
    renew(s.pairs, block_count(size) + 1), renew(s.reach, block_count(size) + 1);
    s.capacity = size;
    reserve_pairs(s, s.room);
    reserve_spill(s, std::max(s.spill_room, 64));
    s.fresh = 0;
}

void Grains::set_threads(int threads) {
    for (int t = 0; t < s.threads; ++t) std::free(s.bench[t]);
    std::free(s.bench);
    s.bench = nullptr, s.bench_pushes = 0, s.bench_pairs = 0;
    s.threads = threads;
    grow(s.bench, 0, threads);
    renew(s.cut, threads + 1), renew(s.late, threads), renew(s.speed, threads);
    // the list stays as it is, only its shares change
    if (s.fresh) baseline::share(s);
}

// -- what comes and goes -----------------------------------------------------------------------------

void Grains::keep_springs() {
    if (s.kept_count >= 0) return;
    s.kept_count = 0;
    if (s.law_kind == VISCOUS) return;
    for (int b = 0; b < block_count(s.n); ++b)
        for (int p = b * s.room; p < b * s.room + s.pairs[b]; ++p)
            if (s.touching[p]) {
                const int k = s.kept_count++;
                s.kept[2 * k] = s.first[p], s.kept[2 * k + 1] = s.second[p];
                std::memcpy(s.kept_shear + 4 * k, s.shear + 4 * p, 32);
            }
}

void Grains::refresh() {
    keep_springs();
    s.fresh = 0;
}

void Grains::clear() {
    s.n = 0, s.kept_count = 0, s.fresh = 0, s.largest = 0.0, s.mono = 1;
}

void Grains::add(int count, const double* x, const double* v, const double* radius, const double* mass,
                 const std::uint8_t* held, const std::int64_t* id) {
    refresh();
    reserve(s.n + count);
    for (int k = 0; k < count; ++k) {
        const int i = s.n++;
        for (int d = 0; d < 3; ++d) s.x[4 * i + d] = x[3 * k + d], s.v[8 * i + d] = v[3 * k + d];
        s.x[4 * i + 3] = radius[k], s.v[8 * i + 3] = 1.0 / mass[k];
        for (int d = 0; d < 3; ++d) s.v[8 * i + 4 + d] = 0.0;
        s.v[8 * i + 7] = held[k] ? 0.0 : 1.0 / mass[k];
        std::fill_n(s.force + 4 * i, 4, 0.0);
        for (double* spring : s.spring) std::fill_n(spring + 4 * i, 4, 0.0);
        std::fill_n(s.record + 8 * i, 8, 0.0);
        s.id[i] = id[k], s.marks[i] = 0;
        s.largest = std::max(s.largest, radius[k]);
        s.mono = s.mono && s.x[4 * i + 3] == s.x[3] && s.v[8 * i + 3] == s.v[3];
    }
    stretch();
}

std::vector<std::int64_t> Grains::remove_beyond(double z) {
    std::vector<std::int64_t> gone;
    std::vector<std::uint8_t> leaves(s.n);
    for (int i = 0; i < s.n; ++i) {
        // what another process moves, that process takes out
        leaves[i] = !(s.marks[i] & GHOST) && place_along(s, s.x + 4 * i) > z;
        if (leaves[i]) gone.push_back(s.id[i]);
    }
    if (!gone.empty()) take_out(leaves.data());
    return gone;
}

void Grains::take_out(const std::uint8_t* leaves) {
    refresh();
    int to = 0;
    for (int i = 0; i < s.n; ++i) {
        const bool stays = !leaves[i];
        s.cell[i] = stays ? to : -1;
        if (!stays) continue;
        std::memmove(s.x + 4 * to, s.x + 4 * i, 32), std::memmove(s.v + 8 * to, s.v + 8 * i, 64);
        std::memmove(s.force + 4 * to, s.force + 4 * i, 32);
        for (double* spring : s.spring) std::memmove(spring + 4 * to, spring + 4 * i, 32);
        std::memmove(s.record + 8 * to, s.record + 8 * i, 64);
        s.marks[to] = s.marks[i], s.id[to++] = s.id[i];
    }
    int kept = 0;
    for (int k = 0; k < s.kept_count; ++k) {
        const int i = s.cell[s.kept[2 * k]], j = s.cell[s.kept[2 * k + 1]];
        if (i < 0 || j < 0) continue;
        s.kept[2 * kept] = i, s.kept[2 * kept + 1] = j;
        std::memmove(s.kept_shear + 4 * kept++, s.kept_shear + 4 * k, 32);
    }
    s.kept_count = kept;
    // rows that vector code reads behind the last grain are at rest and have no size
    for (int i = to; i < std::min(s.n, to + PAD); ++i) {
        std::fill_n(s.x + 4 * i, 4, 0.0), std::fill_n(s.v + 8 * i, 8, 0.0);
        std::fill_n(s.force + 4 * i, 4, 0.0);
        for (double* spring : s.spring) std::fill_n(spring + 4 * i, 4, 0.0);
        s.marks[i] = 0;
    }
    s.n = to;
}

bool Grains::run(int steps) {
    if (s.n > 0) choice().run(s, steps);
    else s.steps += steps, s.failed = 0;
    return !s.failed;
}

void Grains::resize(int n, int room, int spill_room) {
    clear();
    reserve(n);
    if (room != s.room) reserve_pairs(s, room);
    if (spill_room > s.spill_room) reserve_spill(s, spill_room);
    std::memset(s.x, 0, 32 * (std::size_t(s.capacity) + PAD));
    std::memset(s.v, 0, 64 * (std::size_t(s.capacity) + PAD));
    std::memset(s.marks, 0, std::size_t(s.capacity) + PAD);
    s.n = n;
}

void Grains::keep_pairs(int count, const std::int64_t* pairs, const double* shear) {
    if (count == 0) return;
    refresh();
    const int most = block_count(s.capacity) * s.room, all = s.kept_count + count;
    if (all > most) reserve_pairs(s, all / block_count(s.capacity) + 1);
    std::vector<std::pair<std::int64_t, int>> known(s.n);
    for (int i = 0; i < s.n; ++i) known[i] = {s.id[i], i};
    std::sort(known.begin(), known.end());
    const auto find = [&](std::int64_t id) {
        const auto at = std::lower_bound(known.begin(), known.end(), std::make_pair(id, -1));
        return at != known.end() && at->first == id ? at->second : -1;
    };
    for (int k = 0; k < count; ++k) {
        const int i = find(pairs[2 * k]), j = find(pairs[2 * k + 1]);
        if (i < 0 || j < 0) continue;
        s.kept[2 * s.kept_count] = i, s.kept[2 * s.kept_count + 1] = j;
        std::memcpy(s.kept_shear + 4 * s.kept_count++, shear + 4 * k, 32);
    }
}

void Grains::append(int count, const double* rows) {
    refresh();
    reserve(s.n + count);
    for (int k = 0; k < count; ++k, rows += ROW) {
        const int i = s.n++;
        std::memcpy(s.x + 4 * i, rows, 32), std::memcpy(s.v + 8 * i, rows + 4, 64);
        std::memcpy(s.force + 4 * i, rows + 12, 32);
        for (int q = 0; q < SLOTS; ++q) std::memcpy(s.spring[q] + 4 * i, rows + 16 + 4 * q, 32);
        std::fill_n(s.record + 8 * i, 8, 0.0);
        s.id[i] = std::int64_t(rows[ROW - 2]), s.marks[i] = std::uint8_t(rows[ROW - 1]);
        s.largest = std::max(s.largest, s.x[4 * i + 3]);
        s.mono = s.mono && s.x[4 * i + 3] == s.x[3] && s.v[8 * i + 3] == s.v[3];
    }
    stretch();
}

std::vector<double> Grains::some(const std::vector<int>& which) const {
    std::vector<double> found(ROW * which.size());
    double* to = found.data();
    for (const int i : which) {
        std::memcpy(to, s.x + 4 * i, 32), std::memcpy(to + 4, s.v + 8 * i, 64);
        std::memcpy(to + 12, s.force + 4 * i, 32);
        for (int q = 0; q < SLOTS; ++q) std::memcpy(to + 16 + 4 * q, s.spring[q] + 4 * i, 32);
        to[ROW - 2] = double(s.id[i]), to[ROW - 1] = s.marks[i];
        to += ROW;
    }
    return found;
}

void Grains::finish_restore() {
    s.failed = 0;
    std::memset(s.pressed, 1, std::size_t(SLOTS) * s.n);
    for (int i = 0; i < s.n; ++i) {
        s.largest = std::max(s.largest, s.x[4 * i + 3]);
        s.mono = s.mono && s.x[4 * i + 3] == s.x[3] && s.v[8 * i + 3] == s.v[3];
    }
    stretch();
    if (s.fresh) baseline::share(s);
    if (s.fresh && s.triangles) list_surface(s);
}

}  // namespace fem_tfm::grains
