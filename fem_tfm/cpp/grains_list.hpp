// SPDX-License-Identifier: LGPL-3.0-or-later
// Neighbour list: grains are sorted by cells along z, then listed with those within reach behind them.
//
// Included by grains_step.cpp alone. In a narrow tube the cells are slices, thinner than the reach, so
// that candidates are one row of grains; in a wide one they are boxes, sorted z, y, x.
#pragma once

INLINE int cell_at(const Cells& c, int k, double x) {
    const double at = (x - c.low[k]) / c.size[k];
    return at <= 0.0 ? 0 : at >= c.count[k] - 1 ? c.count[k] - 1 : int(at);
}
INLINE int cell_of(const Cells& c, const double* x) {
    return (cell_at(c, 2, x[2]) * c.count[1] + cell_at(c, 1, x[1])) * c.count[0] + cell_at(c, 0, x[0]);
}

// A tube that holds at most this many boxes side by side is cut into slices.
constexpr int NARROW = 16;

INLINE bool finite(double a) { return a - a == 0.0; }

// Rows of places by which grains are sorted: in a bend those of the straight line.
INLINE double* sorted_by(const State& s) { return s.walls.kind == BENT ? s.straight : s.x; }

// Returns whether all places are finite.
inline bool survey(const State& s, Cells& c) {
    double high[3];
    const double* at = sorted_by(s);
    if (s.walls.kind == BENT)
        for (int i = 0; i < s.n; ++i) straighten(s.arc, s.x + 4 * i, s.straight + 4 * i);
    for (int k = 0; k < 3; ++k) c.low[k] = high[k] = at[k];
    bool good = true;
    for (int i = 0; i < s.n; ++i)
        for (int k = 0; k < 3; ++k) {
            const double x = at[4 * i + k];
            good = good && finite(x) && finite(s.v[8 * i + k]);
            if (x < c.low[k]) c.low[k] = x;
            if (x > high[k]) high[k] = x;
        }
    if (!good) return false;
    const double reach = 2.0 * s.largest + s.skin;
    const double along = s.walls.kind == BENT ? s.arc.stretch * reach : reach;
    double boxes[3];
    for (int k = 0; k < 3; ++k) {
        boxes[k] = (high[k] - c.low[k]) / (k == 2 ? along : reach);
        boxes[k] = boxes[k] < 1.0 ? 1.0 : boxes[k] > 1000.0 && k < 2 ? 1000.0 : boxes[k];
    }
    const bool narrow = int(boxes[0]) * int(boxes[1]) <= NARROW;
    c.layers = narrow ? 4 : 1;
    for (int k = 0; k < 2; ++k) c.count[k] = narrow ? 1 : int(boxes[k]);
    double slabs = boxes[2] * c.layers;
    const double most_slabs = (8.0 * s.n + 1000.0) / (c.count[0] * c.count[1]);
    if (slabs > most_slabs) slabs = most_slabs < 1.0 ? 1.0 : most_slabs;
    c.count[2] = int(slabs);
    for (int k = 0; k < 3; ++k) {
        const double least_size = k == 2 ? along / c.layers : reach;
        c.size[k] = (high[k] - c.low[k]) / c.count[k];
        if (c.size[k] < least_size) c.size[k] = least_size;
    }
    return true;
}

// Put rows of `width` doubles into the new order.
INLINE void permute(double* a, double* spare, const int* order, int n, int width) {
    for (int i = 0; i < n; ++i)
        __builtin_memcpy(spare + std::ptrdiff_t(width) * i, a + std::ptrdiff_t(width) * order[i], 8 * width);
    __builtin_memcpy(a, spare, std::size_t(8) * width * n);
}

// Sort by cells, stable; `cell` then tells the new number of an old one.
inline void sort(State& s, const Cells& c) {
    const int total = c.count[0] * c.count[1] * c.count[2], n = s.n;
    const double* at = sorted_by(s);
    if (total + 2 > s.slab_room) reserve_slabs(s, total + total / 4 + 2);
    int* start = s.slab;
    for (int k = 0; k <= total + 1; ++k) start[k] = 0;
    for (int i = 0; i < n; ++i) {
        s.cell[i] = cell_of(c, at + 4 * i);
        ++start[s.cell[i] + 2];
    }
    for (int k = 2; k <= total + 1; ++k) start[k] += start[k - 1];
    for (int i = 0; i < n; ++i) s.order[start[s.cell[i] + 1]++] = i;
    for (int i = 0; i < n; ++i) s.cell[s.order[i]] = i;
    permute(s.x, s.spare, s.order, n, 4);
    if (s.walls.kind == BENT) permute(s.straight, s.spare, s.order, n, 4);
    permute(s.v, s.spare, s.order, n, 8);
    permute(s.force, s.spare, s.order, n, 4);
    for (double* spring : s.spring)
        if (s.law_kind != VISCOUS) permute(spring, s.spare, s.order, n, 4);
    std::uint8_t* spare = (std::uint8_t*)s.spare;
    for (int i = 0; i < n; ++i) spare[i] = s.marks[s.order[i]];
    __builtin_memcpy(s.marks, spare, n);
    __builtin_memset(s.pressed, 1, std::size_t(SLOTS) * n);
    permute((double*)s.id, s.spare, s.order, n, 1);
    __builtin_memcpy(s.origin, s.x, std::size_t(32) * n);
    for (int i = 0; i < n; ++i)
        for (int k = 0; k < 4; ++k) s.column[std::ptrdiff_t(k) * s.capacity + i] = s.x[4 * i + k];
}

// Springs of the pairs in contact, kept over the making of a list; returns how many.
inline int keep(State& s) {
    int found = 0;
    for (int b = 0; b < blocks(s); ++b)
        for (int p = b * s.room; p < b * s.room + s.pairs[b]; ++p)
            if (s.touching[p]) {
                s.kept[2 * found] = s.first[p], s.kept[2 * found + 1] = s.second[p];
                store_row(s.kept_shear + 4 * found++, load_row(s.shear + 4 * p));
            }
    return found;
}

inline void put_back(State& s, int count) {
    for (int k = 0; k < count; ++k) {
        const int i = s.cell[s.kept[2 * k]], j = s.cell[s.kept[2 * k + 1]];
        const int low = least(i, j), high = most(i, j);
        const row shear = load_row(s.kept_shear + 4 * k);
        for (int p = s.begin[low]; p < s.begin[low] + s.amount[low]; ++p)
            if (s.second[p] == high) {
                store_row(s.shear + 4 * p, low == i ? shear : -shear);
                s.touching[p] = 255;
            }
    }
}

// Candidates of one grain in the sorted row from `from` to `to`; returns the end of the list.
INLINE int list_row(State& s, int i, int from, int to, int p, double reach) {
    const double *x = s.column, *y = x + s.capacity, *z = y + s.capacity, *r = z + s.capacity;
    const column xi = all(x[i]), yi = all(y[i]), zi = all(z[i]), ri = all(r[i] + reach);
    int number[W];
    for (int j = from; j < to; j += W) {
        const column dx = load_column(x + j) - xi, dy = load_column(y + j) - yi;
        const column dz = load_column(z + j) - zi, sum = load_column(r + j) + ri;
        const unsigned valid = to - j >= W ? (1u << W) - 1 : (1u << (to - j)) - 1;
        const unsigned hit = below(dx * dx + dy * dy + dz * dz, sum * sum) & valid;
        for (int k = 0; k < W; ++k) number[k] = j + k;
        pack(s.second + p, hit, number);
        for (int k = 0; k < W; ++k) s.first[p + k] = i;
        p += __builtin_popcount(hit);
    }
    return p;
}

// List of one block; `overflow` is set where its room does not do.
inline void list_block(State& s, const Cells& c, int b) {
    const int base = b * s.room, end = behind(s, b);
    const double* at = sorted_by(s);
    const int *start = s.slab, nx = c.count[0], ny = c.count[1], nz = c.count[2];
    int p = base, far = end;
    for (int i = b * BLOCK; i < end; ++i) {
        const int before = p;
        const int cx = cell_at(c, 0, at[4 * i]), cy = cell_at(c, 1, at[4 * i + 1]), cz = cell_at(c, 2, at[4 * i + 2]);
        for (int dz = 0; dz <= (c.layers > 1 ? 0 : 1) && cz + dz < nz; ++dz)
            for (int dy = dz ? -1 : 0; dy <= 1; ++dy) {
                if (cy + dy < 0 || cy + dy >= ny) continue;
                const int line = ((cz + dz) * ny + cy + dy) * nx;
                int from = start[line + most(cx - 1, 0)], to = start[line + least(cx + 1, nx - 1) + 1];
                if (c.layers > 1) to = start[least(cz + c.layers, nz - 1) + 1];
                if (dz == 0 && dy == 0) from = i + 1;
                if (p - base + 2 * W + (to - from) > s.room) {
#pragma omp atomic write
                    s.overflow = s.room + to - from + 2 * W;
                    return;
                }
                p = list_row(s, i, from, to, p, s.skin);
            }
        s.begin[i] = before, s.amount[i] = p - before;
        for (int q = before; q < p; ++q) far = most(far, s.second[q] + 1);
    }
    for (int k = 0; k < W; ++k) s.first[p + k] = s.second[p + k] = b * BLOCK;
    s.pairs[b] = p - base, s.reach[b] = far - end;
    if (s.law_kind != VISCOUS)
        for (int q = base; q < p + W; ++q) s.touching[q] = 0, store_row(s.shear + 4 * q, row{});
}

// Shares of the threads by their pairs, and what must wait for the threads before.
inline void share_out(State& s, int size) {
    const int count = blocks(s);
    std::int64_t total = 0, done = 0;
    int widest = 0, longest = 0, latest = 0, far = 0, t = 0;
    for (int b = 0; b < count; ++b) {
        total += s.pairs[b] + 2 * BLOCK;
        widest = most(widest, s.reach[b]), longest = most(longest, s.pairs[b]);
    }
    s.cut[0] = 0;
    for (int b = 0; b < count; ++b) {
        while (t + 1 < s.threads && done * s.threads >= total * (t + 1)) s.cut[++t] = b;
        done += s.pairs[b] + 2 * BLOCK;
    }
    while (t < s.threads) s.cut[++t] = count;
    for (t = 0; t < s.threads; ++t) {
        int b = s.cut[t];
        while (b < s.cut[t + 1] && b * BLOCK < far) ++b;
        s.late[t] = b - s.cut[t], latest = most(latest, s.late[t]);
        for (b = s.cut[t]; b < s.cut[t + 1]; ++b) far = most(far, behind(s, b) + s.reach[b]);
    }
    if (widest > s.spill_room) reserve_spill(s, widest + widest / 4);
    reserve_benches(s, std::size_t(size) * (latest + 1) * (BLOCK + s.spill_room + PAD), longest + 4 * PAD);
}

// A new list, made by all threads together; every thread calls it.
inline void rebuild(State& s, int size) {
#pragma omp single
    {
        if (s.kept_count < 0) s.kept_count = s.law_kind == VISCOUS ? 0 : keep(s);
        s.failed = survey(s, s.cells) ? 0 : 1;
        if (!s.failed) sort(s, s.cells);
    }
    if (s.failed) return;
    for (;;) {
#pragma omp single
        s.overflow = 0;
#pragma omp for schedule(dynamic)
        for (int b = 0; b < blocks(s); ++b) list_block(s, s.cells, b);
        if (!s.overflow) break;
#pragma omp barrier
#pragma omp single
        reserve_pairs(s, s.overflow + s.overflow / 4);
    }
#pragma omp single
    {
        put_back(s, s.kept_count);
        share_out(s, size);
        if (s.triangles) list_surface(s);
        s.kept_count = -1, s.fresh = 1, s.travelled = 0.0, ++s.rebuilds;
    }
}
