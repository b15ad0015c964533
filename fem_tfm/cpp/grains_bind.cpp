// SPDX-License-Identifier: LGPL-3.0-or-later
// What Python sees of the grains.
#include "grains_bind.hpp"

#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "grains.hpp"
#include "grains_tents.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace fem_tfm::grains {
namespace {

#include "grains_arc.hpp"

template <class T>
using Array = nb::ndarray<nb::numpy, T>;
template <class T>
using Given = nb::ndarray<const T, nb::c_contig, nb::device::cpu>;

// A copy as a numpy array.
template <class T>
Array<T> copied(const T* from, std::vector<std::size_t> shape) {
    std::size_t count = 1;
    for (std::size_t n : shape) count *= n;
    T* data = new T[count ? count : 1];
    std::memcpy(data, from, count * sizeof(T));
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
    return Array<T>(data, shape.size(), shape.data(), owner);
}

// The memory itself; it is valid until grains come or go.
template <class T>
Array<T> view(nb::handle owner, T* data, std::vector<std::size_t> shape) {
    return Array<T>(data, shape.size(), shape.data(), owner);
}

// springs at walls in a saved state
constexpr const char* SPRING_NAMES[SLOTS] = {"spring_0", "spring_1", "spring_2"};

Law law_of(const std::vector<double>& c) {
    return {c.at(0), c.at(1), c.at(2), c.at(3), c.at(4), c.at(5), c.at(6)};
}

nb::dict save(Grains& g) {
    State& s = g.s;
    if (!s.fresh) g.keep_springs();
    const std::size_t n = s.n, count = (n + BLOCK - 1) / BLOCK;
    nb::dict d;
    d["place"] = copied(s.x, {n, 4}), d["motion"] = copied(s.v, {n, 8});
    d["force"] = copied(s.force, {n, 4});
    for (int k = 0; k < SLOTS; ++k) d[SPRING_NAMES[k]] = copied(s.spring[k], {n, 4});
    d["marks"] = copied(s.marks, {n});
    d["number"] = copied(s.id, {n}), d["origin"] = copied(s.origin, {n, 4});
    d["counters"] = copied(std::array<std::int64_t, 3>{s.steps, s.rebuilds, s.contacts}.data(), {3});
    d["travelled"] = copied(&s.travelled, {1});
    const std::array<std::int64_t, 4> sizes{s.fresh, s.room, s.spill_room, s.kept_count};
    d["sizes"] = copied(sizes.data(), {4});
    if (!s.fresh) {
        const std::size_t k = s.kept_count;
        d["kept"] = copied(s.kept, {k, 2}), d["kept_shear"] = copied(s.kept_shear, {k, 4});
        return d;
    }
    std::vector<int> pairs;
    std::vector<double> shear;
    for (std::size_t b = 0; b < count; ++b)
        for (int p = int(b) * s.room; p < int(b) * s.room + s.pairs[b]; ++p) {
            pairs.insert(pairs.end(), {s.first[p], s.second[p], s.touching[p]});
            shear.insert(shear.end(), s.shear + 4 * p, s.shear + 4 * p + 4);
        }
    d["pairs"] = copied(pairs.data(), {pairs.size() / 3, 3});
    d["shear"] = copied(shear.data(), {shear.size() / 4, 4});
    d["listed"] = copied(s.pairs, {count}), d["reach"] = copied(s.reach, {count});
    d["begin"] = copied(s.begin, {n}), d["amount"] = copied(s.amount, {n});
    return d;
}

template <class T>
std::size_t fill(nb::dict d, const char* name, T* to) {
    const auto a = nb::cast<Given<T>>(d[name]);
    std::memcpy(to, a.data(), a.size() * sizeof(T));
    return a.size();
}

void load(Grains& g, nb::dict d) {
    State& s = g.s;
    std::int64_t sizes[4], counters[3];
    fill(d, "sizes", sizes), fill(d, "counters", counters);
    const std::size_t n = nb::cast<Given<std::int64_t>>(d["number"]).size();
    g.resize(int(n), int(sizes[1]), int(sizes[2]));
    fill(d, "place", s.x), fill(d, "motion", s.v), fill(d, "force", s.force);
    for (int k = 0; k < SLOTS; ++k) fill(d, SPRING_NAMES[k], s.spring[k]);
    if (d.contains("marks")) fill(d, "marks", s.marks);
    fill(d, "number", s.id), fill(d, "origin", s.origin), fill(d, "travelled", &s.travelled);
    s.steps = counters[0], s.rebuilds = counters[1], s.contacts = counters[2];
    s.fresh = int(sizes[0]), s.kept_count = int(sizes[3]);
    if (!s.fresh) {
        fill(d, "kept", s.kept), fill(d, "kept_shear", s.kept_shear);
    } else {
        fill(d, "listed", s.pairs), fill(d, "reach", s.reach);
        fill(d, "begin", s.begin), fill(d, "amount", s.amount);
        const auto pairs = nb::cast<Given<int>>(d["pairs"]);
        const auto shear = nb::cast<Given<double>>(d["shear"]);
        const int* p = pairs.data();
        const double* h = shear.data();
        for (int b = 0; b * BLOCK < s.n; ++b) {
            int q = b * s.room;
            for (int k = 0; k < s.pairs[b]; ++k, ++q, p += 3, h += 4) {
                s.first[q] = p[0], s.second[q] = p[1], s.touching[q] = std::uint8_t(p[2]);
                std::memcpy(s.shear + 4 * q, h, 32);
            }
            for (int k = 0; k < PAD; ++k, ++q) s.first[q] = s.second[q] = b * BLOCK, s.touching[q] = 0;
        }
    }
    g.finish_restore();
}

// What another process needs of a grain: place, velocity, radius times spin.
constexpr int PACKED = 9;

void check_packed(const Grains& g, const Given<int>& which, std::size_t size) {
    if (size != PACKED * which.size()) throw std::invalid_argument("packed grains have nine numbers");
    for (std::size_t k = 0; k < which.size(); ++k)
        if (which.data()[k] < 0 || which.data()[k] >= g.s.n) throw std::out_of_range("no such grain");
}

// Springs of the pairs in contact of which a grain is flagged, or of all: numbers of the grains, the
// smaller first, and the springs.
void springs(Grains& g, const std::uint8_t* flags, std::vector<std::int64_t>& pairs,
             std::vector<double>& shear) {
    State& s = g.s;
    if (s.law_kind == VISCOUS) return;
    if (!s.fresh) g.keep_springs();
    const auto add = [&](int i, int j, const double* h) {
        if (flags && !flags[i] && !flags[j]) return;
        const double sign = s.id[i] < s.id[j] ? 1.0 : -1.0;
        pairs.insert(pairs.end(), {std::min(s.id[i], s.id[j]), std::max(s.id[i], s.id[j])});
        for (int k = 0; k < 4; ++k) shear.push_back(sign * h[k]);
    };
    for (int k = 0; !s.fresh && k < s.kept_count; ++k)
        add(s.kept[2 * k], s.kept[2 * k + 1], s.kept_shear + 4 * k);
    for (int b = 0; s.fresh && b * BLOCK < s.n; ++b)
        for (int p = b * s.room; p < b * s.room + s.pairs[b]; ++p)
            if (s.touching[p]) add(s.first[p], s.second[p], s.shear + 4 * p);
}

nb::dict rows(Grains& g) {
    State& s = g.s;
    if (!s.fresh) g.keep_springs();
    const std::size_t n = s.n;
    nb::dict d;
    d["place"] = copied(s.x, {n, 4}), d["motion"] = copied(s.v, {n, 8});
    d["force"] = copied(s.force, {n, 4});
    for (int k = 0; k < SLOTS; ++k) d[SPRING_NAMES[k]] = copied(s.spring[k], {n, 4});
    d["marks"] = copied(s.marks, {n}), d["number"] = copied(s.id, {n});
    std::vector<std::int64_t> pairs;
    std::vector<double> shear;
    springs(g, nullptr, pairs, shear);
    d["pairs"] = copied(pairs.data(), {pairs.size() / 2, 2});
    d["shear"] = copied(shear.data(), {shear.size() / 4, 4});
    return d;
}

void set_rows(Grains& g, nb::dict d) {
    State& s = g.s;
    const std::size_t n = nb::cast<Given<std::int64_t>>(d["number"]).size();
    g.resize(int(n), s.room, s.spill_room);
    s.fresh = 0, s.kept_count = 0;
    fill(d, "place", s.x), fill(d, "motion", s.v), fill(d, "force", s.force);
    for (int k = 0; k < SLOTS; ++k) fill(d, SPRING_NAMES[k], s.spring[k]);
    fill(d, "marks", s.marks), fill(d, "number", s.id);
    const auto pairs = nb::cast<Given<std::int64_t>>(d["pairs"]);
    const auto shear = nb::cast<Given<double>>(d["shear"]);
    g.keep_pairs(int(pairs.size() / 2), pairs.data(), shear.data());
    g.finish_restore();
}

}  // namespace

void bind_grains(nb::module_& m) {
    m.def("instruction_sets", &instruction_sets, "Instruction sets that this machine runs, best first");
    m.def("use_instruction_set", [](const std::string& name) { use(name.c_str()); });
    m.def("instruction_set", &used);
    nb::class_<Grains>(m, "Grains")
        .def(nb::init<>())
        .def_prop_ro("count", [](const Grains& g) { return g.s.n; })
        .def_prop_ro("steps", [](const Grains& g) { return g.s.steps; })
        .def_prop_ro("rebuilds", [](const Grains& g) { return g.s.rebuilds; })
        .def_prop_ro("stale", [](const Grains& g) { return g.s.n > 0 && !g.s.fresh; })
        .def_prop_ro("contacts", [](const Grains& g) { return g.s.contacts; })
        .def_prop_ro("fastest", [](const Grains& g) { return g.s.fastest; })
        .def_prop_ro("listed", [](const Grains& g) {
            std::int64_t total = 0;
            for (int b = 0; g.s.fresh && b * BLOCK < g.s.n; ++b) total += g.s.pairs[b];
            return total;
        })
        .def("set_law", [](Grains& g, int kind, const std::vector<double>& pair,
                           const std::vector<double>& wall) {
            g.refresh();
            g.s.law_kind = kind, g.s.pair = law_of(pair), g.s.wall = law_of(wall);
            g.s.rolling = g.s.pair.mr > 0.0 || g.s.wall.mr > 0.0;
        }, "kind"_a, "pair"_a, "wall"_a)
        .def("set_walls", [](Grains& g, int kind, double radius, double half_width, double half_height,
                             double low, double high, bool low_closed, bool high_closed) {
            g.s.walls = {kind, radius, half_width, half_height, low_closed, high_closed, low, high};
        }, "kind"_a, "radius"_a, "half_width"_a, "half_height"_a, "low"_a, "high"_a, "low_closed"_a,
           "high_closed"_a)
        .def("set_arc", [](Grains& g, std::array<double, 2> normal, double radius, double angle,
                           double before) {
            g.set_arc(normal.data(), radius, angle, before);
        }, "normal"_a, "radius"_a, "angle"_a, "before"_a)
        .def("set_surface", [](Grains& g, Given<double> corners) {
            if (corners.size() % 9) throw std::invalid_argument("triangles have nine numbers");
            g.set_surface(int(corners.size() / 9), corners.data());
        }, "corners"_a)
        .def("set_motion", [](Grains& g, double dt, std::array<double, 3> gravity, double skin,
                              double release) {
            if (skin != g.s.skin) g.refresh();
            g.s.dt = dt, g.s.skin = skin, g.s.release = release;
            g.stretch();
            for (int k = 0; k < 3; ++k) g.s.gravity[k] = gravity[k];
        }, "dt"_a, "gravity"_a, "skin"_a, "release"_a)
        .def_prop_rw("threads", [](const Grains& g) { return g.s.threads; }, &Grains::set_threads)
        .def_prop_rw("recording", [](const Grains& g) { return g.s.recording != 0; },
                     [](Grains& g, bool on) { g.s.recording = on; })
        .def_prop_rw("watching", [](const Grains& g) { return g.s.watching != 0; },
                     [](Grains& g, bool on) { g.s.watching = on; })
        .def("impacts", [](Grains& g) {
            const std::vector<double> rows = g.take_impacts();
            return copied(rows.data(), {rows.size() / IMPACT, std::size_t(IMPACT)});
        })
        .def("straight", [](const Grains& g) {
            std::vector<double> found(3 * std::size_t(g.s.n));
            for (int i = 0; i < g.s.n; ++i) {
                const double* x = g.s.x + 4 * i;
                if (g.s.walls.kind == BENT) straighten(g.s.arc, x, &found[3 * std::size_t(i)]);
                else std::copy(x, x + 3, &found[3 * std::size_t(i)]);
            }
            return copied(found.data(), {std::size_t(g.s.n), 3});
        })
        .def("add", [](Grains& g, Given<double> x, Given<double> v, Given<double> radius,
                       Given<double> mass, Given<std::uint8_t> held, Given<std::int64_t> number) {
            const std::size_t n = radius.size();
            if (x.size() != 3 * n || v.size() != 3 * n || mass.size() != n || held.size() != n ||
                number.size() != n)
                throw std::invalid_argument("arrays of grains differ in length");
            g.add(int(n), x.data(), v.data(), radius.data(), mass.data(), held.data(), number.data());
        }, "place"_a, "velocity"_a, "radius"_a, "mass"_a, "held"_a, "number"_a)
        .def("remove_beyond", [](Grains& g, double z) {
            const std::vector<std::int64_t> gone = g.remove_beyond(z);
            return copied(gone.data(), {gone.size()});
        })
        .def("run", &Grains::run, "steps"_a, nb::call_guard<nb::gil_scoped_release>())
        .def("clear", &Grains::clear)
        .def("rows", &rows, "Grains as rows and springs of their pairs, without the neighbour list")
        .def("set_rows", &set_rows, "rows"_a)
        // some grains as a table, and the springs of pairs that they are part of
        .def("some", [](Grains& g, Given<int> which) {
            const std::vector<int> chosen(which.data(), which.data() + which.size());
            std::vector<std::uint8_t> flags(g.s.n);
            for (const int i : chosen) {
                if (i < 0 || i >= g.s.n) throw std::out_of_range("no such grain");
                flags[i] = 1;
            }
            std::vector<std::int64_t> pairs;
            std::vector<double> shear;
            springs(g, flags.data(), pairs, shear);
            const std::vector<double> table = g.some(chosen);
            return nb::make_tuple(copied(table.data(), {chosen.size(), std::size_t(ROW)}),
                                  copied(pairs.data(), {pairs.size() / 2, 2}),
                                  copied(shear.data(), {shear.size() / 4, 4}));
        }, "which"_a)
        .def("take_out", [](Grains& g, Given<std::uint8_t> flags) {
            if (flags.size() != std::size_t(g.s.n)) throw std::invalid_argument("a flag a grain");
            g.take_out(flags.data());
        }, "flags"_a)
        .def("append", [](Grains& g, Given<double> table, Given<std::int64_t> pairs, Given<double> shear) {
            if (table.size() % ROW || 2 * pairs.size() != shear.size())
                throw std::invalid_argument("rows of another length");
            g.append(int(table.size() / ROW), table.data());
            g.keep_pairs(int(pairs.size() / 2), pairs.data(), shear.data());
        }, "table"_a, "pairs"_a, "shear"_a)
        // x, y, z, velocity and radius times spin of some grains, to and from another process
        .def("pack", [](const Grains& g, Given<int> which, nb::ndarray<double, nb::c_contig> out) {
            check_packed(g, which, out.size());
            double* to = out.data();
            for (std::size_t k = 0; k < which.size(); ++k, to += PACKED) {
                const double *x = g.s.x + 4 * which.data()[k], *v = g.s.v + 8 * which.data()[k];
                std::copy(x, x + 3, to), std::copy(v, v + 3, to + 3), std::copy(v + 4, v + 7, to + 6);
            }
        })
        .def("unpack", [](Grains& g, Given<int> which, Given<double> from) {
            check_packed(g, which, from.size());
            const double* row = from.data();
            for (std::size_t k = 0; k < which.size(); ++k, row += PACKED) {
                double *x = g.s.x + 4 * which.data()[k], *v = g.s.v + 8 * which.data()[k];
                std::copy(row, row + 3, x), std::copy(row + 3, row + 6, v), std::copy(row + 6, row + 9, v + 4);
                // it is moved there, and held here
                v[7] = 0.0;
            }
        })
        .def("save", &save)
        .def("load", &load)
        // rows of memory: valid until grains come or go, or steps are run
        .def_prop_ro("place", [](nb::handle_t<Grains> self) {
            State& s = nb::cast<Grains&>(self).s;
            return view(self, s.x, {std::size_t(s.n), 4});
        })
        .def_prop_ro("motion", [](nb::handle_t<Grains> self) {
            State& s = nb::cast<Grains&>(self).s;
            return view(self, s.v, {std::size_t(s.n), 8});
        })
        .def_prop_ro("force", [](nb::handle_t<Grains> self) {
            State& s = nb::cast<Grains&>(self).s;
            return view(self, s.force, {std::size_t(s.n), 4});
        })
        .def_prop_ro("record", [](nb::handle_t<Grains> self) {
            State& s = nb::cast<Grains&>(self).s;
            return view(self, s.record, {std::size_t(s.n), 8});
        })
        .def_prop_ro("marks", [](nb::handle_t<Grains> self) {
            State& s = nb::cast<Grains&>(self).s;
            return view(self, s.marks, {std::size_t(s.n)});
        })
        .def_prop_ro("number", [](nb::handle_t<Grains> self) {
            State& s = nb::cast<Grains&>(self).s;
            return view(self, s.id, {std::size_t(s.n)});
        });
    nb::class_<Tents>(m, "Tents")
        .def("__init__", [](Tents* t, Given<double> corners, Given<int> nodes, Given<double> planes) {
            new (t) Tents({corners.data(), corners.data() + corners.size()},
                          {nodes.data(), nodes.data() + nodes.size()},
                          {planes.data(), planes.data() + planes.size()});
        }, "corners"_a, "nodes"_a, "planes"_a)
        .def_prop_ro("nodes", &Tents::node_count)
        .def("locate", [](Tents& t, const Grains& g) { t.locate(g.s); })
        .def("deposit", [](const Tents& t, const Grains& g, nb::ndarray<double, nb::c_contig> volume,
                           nb::ndarray<double, nb::c_contig> momentum) {
            if (t.volume.size() != std::size_t(g.s.n) || volume.size() != std::size_t(t.node_count()) ||
                momentum.size() != 3 * volume.size())
                throw std::invalid_argument("grains that are not located, or arrays of another mesh");
            t.deposit(g.s.v, volume.data(), momentum.data());
        })
        .def("pull", [](const Tents& t, Grains& g, Given<double> field) {
            if (t.volume.size() != std::size_t(g.s.n) || field.size() != 3 * std::size_t(t.node_count()))
                throw std::invalid_argument("grains that are not located, or an array of another mesh");
            t.pull(field.data(), g.s.force);
        })
        .def("weights", [](const Tents& t) {
            const std::size_t n = t.volume.size();
            return nb::make_tuple(copied(t.node.data(), {n, 8}), copied(t.weight.data(), {n, 8}));
        });
}

}  // namespace fem_tfm::grains
