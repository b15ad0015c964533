// SPDX-License-Identifier: LGPL-3.0-or-later
//
// The Python module: arrays in, threads over chunks, sums out.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "grains_bind.hpp"
#include "kernel.h"

namespace kernel_plain {
void advance(const kernel::Job&, int64_t, int64_t, kernel::Output&);
}
#if defined(KERNEL_X86)
namespace kernel_avx2 {
void advance(const kernel::Job&, int64_t, int64_t, kernel::Output&);
}
namespace kernel_avx512 {
void advance(const kernel::Job&, int64_t, int64_t, kernel::Output&);
}
#endif

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <class T>
using Array = nb::ndarray<T, nb::c_contig, nb::device::cpu>;

bool has_avx2() {
#if defined(KERNEL_X86)
    __builtin_cpu_init();
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#else
    return false;
#endif
}

bool has_avx512() {
#if defined(KERNEL_X86)
    return has_avx2() && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") &&
           __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw");
#else
    return false;
#endif
}

kernel::Advance variant(const std::string& name) {
    if (name == "plain") return kernel_plain::advance;
#if defined(KERNEL_X86)
    if (name == "avx2" && has_avx2()) return kernel_avx2::advance;
    if (name == "avx512" && has_avx512()) return kernel_avx512::advance;
#endif
    throw std::invalid_argument("no such variant on this processor: " + name);
}

template <class T>
T* data(const nb::dict& from, const char* name, size_t size) {
    auto array = nb::cast<Array<T>>(from[name]);
    if (array.size() != size) {
        throw std::invalid_argument(std::string(name) + " has the wrong size");
    }
    return array.data();
}

// owns nothing but references: Python keeps the arrays alive
struct Grid {
    kernel::Grid grid{};
    nb::dict arrays;

    Grid(int cells, nb::dict given, int nodes, int folds) : arrays(given) {
        grid.cells = static_cast<kernel::Cells>(cells);
        const kernel::Layout layout = kernel::layout_of(grid.cells);
        grid.count = (int)nb::cast<Array<uint8_t>>(given["curved"]).size();
        grid.nodes = nodes;
        const size_t n = grid.count;
        grid.node = data<int32_t>(given, "node", n * layout.nodes);
        grid.neighbour = data<int32_t>(given, "neighbour", n * layout.facets);
        grid.map = data<float>(given, "map", n * layout.map);
        grid.curved = data<uint8_t>(given, "curved", n);
        grid.any_curved = std::any_of(grid.curved, grid.curved + n, [](uint8_t c) { return c != 0; });
        if (given.contains("near")) {
            grid.near_start = data<int32_t>(given, "near_start", n + 1);
            grid.near = data<int32_t>(given, "near", (size_t)grid.near_start[n]);
            const size_t faces = nb::cast<Array<double>>(given["face"]).size();
            grid.face = data<double>(given, "face", faces);
            for (int32_t i = 0; i < grid.near_start[n]; ++i) {
                if ((size_t)(grid.near[i] + 1) * kernel::FACE > faces) throw std::invalid_argument("near");
            }
        }
        grid.folds = folds;
    }
};

struct Impacts {
    std::vector<kernel::ImpactRecord> records;
};

void add(void* to, const kernel::ImpactRecord& record) {
    static_cast<std::vector<kernel::ImpactRecord>*>(to)->push_back(record);
}

double number(const nb::dict& from, const char* name) { return nb::cast<double>(from[name]); }
int whole(const nb::dict& from, const char* name) { return nb::cast<int>(from[name]); }
bool flag(const nb::dict& from, const char* name) { return nb::cast<bool>(from[name]); }
std::array<double, 3> vector3(const nb::dict& from, const char* name) {
    return nb::cast<std::array<double, 3>>(from[name]);
}

kernel::Geometry geometry_of(const nb::dict& g) {
    kernel::Geometry found;
    found.wall = static_cast<kernel::Wall>(whole(g, "wall"));
    found.half[0] = number(g, "half_x");
    found.half[1] = number(g, "half_y");
    found.strip = number(g, "strip");
    found.before = number(g, "before");
    found.radius = number(g, "radius");
    found.angle = number(g, "angle");
    found.normal[0] = number(g, "normal_x");
    found.normal[1] = number(g, "normal_y");
    found.length = number(g, "length");
    return found;
}

kernel::Gas gas_of(const nb::dict& g, int nodes) {
    kernel::Gas found;
    const size_t size = (size_t)nodes * kernel::ROW;
    found.rows[0] = data<float>(g, "rows", size);
    if (!g["rows_ahead"].is_none()) found.rows[1] = data<float>(g, "rows_ahead", size);
    found.z[0] = number(g, "from");
    found.z[1] = number(g, "to");
    found.density = number(g, "density");
    found.viscosity = number(g, "viscosity");
    found.conductivity = number(g, "conductivity");
    found.heat_capacity = number(g, "heat_capacity");
    return found;
}

kernel::Options options_of(const nb::dict& o, int64_t materials) {
    kernel::Options found;
    found.seed = nb::cast<uint64_t>(o["seed"]);
    const auto gravity = vector3(o, "gravity");
    std::copy(gravity.begin(), gravity.end(), found.gravity);
    found.buoyancy = flag(o, "buoyancy");
    found.pressure = flag(o, "pressure");
    found.saffman = flag(o, "saffman");
    found.magnus = flag(o, "magnus");
    found.heat = flag(o, "heat");
    found.added_mass = number(o, "added_mass");
    found.drag = data<float>(o, "drag", (size_t)materials * kernel::DRAG_ROWS * 4);
    found.heat_capacity = data<double>(o, "particle_heat_capacity", (size_t)materials);
    found.dispersion = static_cast<kernel::Dispersion>(whole(o, "dispersion"));
    found.crossing = number(o, "crossing");
    found.inertia = number(o, "inertia");
    found.impact = static_cast<kernel::Impact>(whole(o, "impact"));
    found.restitution = number(o, "restitution");
    found.friction = number(o, "friction");
    found.roughness = number(o, "roughness");
    found.stick_speed = number(o, "stick_speed");
    found.eddies = number(o, "eddies");
    found.relaxation = number(o, "relaxation");
    found.cells = number(o, "cells");
    found.largest = number(o, "largest");
    found.smallest = number(o, "smallest");
    found.max_steps = nb::cast<int64_t>(o["max_steps"]);
    found.until_time = flag(o, "until_time");
    found.end = number(o, "end");
    return found;
}

kernel::Cloud cloud_of(const nb::dict& c) {
    kernel::Cloud found{};
    const size_t n = nb::cast<Array<int8_t>>(c["status"]).size();
    found.count = (int64_t)n;
    found.id = data<int64_t>(c, "id", n);
    found.material = data<int32_t>(c, "material", n);
    found.x = data<double>(c, "x", 3 * n);
    found.v = data<double>(c, "v", 3 * n);
    found.omega = data<double>(c, "omega", 3 * n);
    found.xi = data<float>(c, "xi", 3 * n);
    found.temperature = data<double>(c, "temperature", n);
    found.time = data<double>(c, "time", n);
    found.cell = data<int32_t>(c, "cell", n);
    found.step = data<uint32_t>(c, "step", n);
    found.status = data<int8_t>(c, "status", n);
    found.rate = data<double>(c, "rate", n);
    found.diameter = data<double>(c, "diameter", n);
    found.density = data<double>(c, "density", n);
    found.bounces = data<uint32_t>(c, "bounces", n);
    found.memory = data<float>(c, "memory", 5 * n);
    found.search = data<int32_t>(c, "search", 2 * n);
    return found;
}

struct Run {
    kernel::Job job{};
    int64_t* sums = nullptr;
    int64_t* heat = nullptr;
    int64_t* pairs = nullptr;
    Impacts* impacts = nullptr;
};

// what one thread writes, added to the whole when it is done
struct Share {
    std::vector<int64_t> sums, heat, pairs;
    std::vector<kernel::ImpactRecord> records;
    kernel::Output out;

    Share(const Run& run, bool alone) {
        const size_t n = run.job.grid.count;
        if (run.sums && !alone) sums.resize(n * kernel::SUMS);
        if (run.heat && !alone) heat.resize(n * 2);
        if (run.pairs && !alone) pairs.resize(n * kernel::PAIRS * run.job.partners.materials);
        out.sinks = run.job.scales;
        out.sinks.sums = alone ? run.sums : sums.data();
        out.sinks.heat = alone ? run.heat : heat.data();
        out.sinks.pairs = alone ? run.pairs : pairs.data();
        out.record = add;
        out.records = &records;
    }

    void give(const Run& run, kernel::Counts& counts) {
        for (size_t i = 0; i < sums.size(); ++i) run.sums[i] += sums[i];
        for (size_t i = 0; i < heat.size(); ++i) run.heat[i] += heat[i];
        for (size_t i = 0; i < pairs.size(); ++i) run.pairs[i] += pairs[i];
        if (run.impacts) {
            auto& all = run.impacts->records;
            all.insert(all.end(), records.begin(), records.end());
        }
        counts.steps += out.counts.steps;
        counts.bounces += out.counts.bounces;
        counts.strays += out.counts.strays;
        counts.collisions += out.counts.collisions;
    }
};

// Advance chunks from `first` on until all are done or the time is up; the first that is not begun.
int64_t work(const Run& run, kernel::Advance advance, int threads, int64_t first, double seconds,
             kernel::Counts& counts) {
    using clock = std::chrono::steady_clock;
    const int64_t chunks = (run.job.cloud.count + kernel::CHUNK - 1) / kernel::CHUNK;
    const auto stop = clock::now() + std::chrono::duration<double>(seconds);
    std::atomic<int64_t> next{first};
    std::vector<Share> shares;
    shares.reserve(threads);
    for (int i = 0; i < threads; ++i) shares.emplace_back(run, threads == 1);
    auto task = [&](Share& share) {
        do {
            const int64_t chunk = next.fetch_add(1);
            if (chunk >= chunks) return;
            const int64_t begin = chunk * kernel::CHUNK;
            advance(run.job, begin, std::min(begin + kernel::CHUNK, run.job.cloud.count), share.out);
        } while (clock::now() < stop);
    };
    std::vector<std::thread> others;
    for (int i = 1; i < threads; ++i) others.emplace_back(task, std::ref(shares[i]));
    task(shares[0]);
    for (auto& other : others) other.join();
    for (auto& share : shares) share.give(run, counts);
    return std::min(next.load(), chunks);
}

Run run_of(const Grid& grid, const nb::dict& geometry, const nb::dict& gas, const nb::dict& options,
           const nb::dict& cloud, const nb::dict& sinks, Impacts* impacts) {
    Run run;
    run.job.grid = grid.grid;
    run.job.geometry = geometry_of(geometry);
    if (run.job.geometry.wall == kernel::Wall::planes && !grid.grid.near) {
        throw std::invalid_argument("a grid without faces");
    }
    run.job.gas = gas_of(gas, grid.grid.nodes);
    const auto capacity = nb::cast<Array<double>>(options["particle_heat_capacity"]);
    run.job.options = options_of(options, (int64_t)capacity.size());
    run.job.cloud = cloud_of(cloud);
    for (int64_t i = 0; i < run.job.cloud.count; ++i) {
        const int32_t material = run.job.cloud.material[i], cell = run.job.cloud.cell[i];
        if (material < 0 || (size_t)material >= capacity.size()) throw std::invalid_argument("material");
        const bool moves = run.job.cloud.status[i] == kernel::INSIDE;
        if (cell >= grid.grid.count || (moves && cell < 0)) throw std::invalid_argument("cell");
    }
    const size_t n = grid.grid.count;
    if (sinks.contains("sums")) {
        run.sums = data<int64_t>(sinks, "sums", n * kernel::SUMS);
        run.job.with_sinks = true;
        run.job.scales.impulse = number(sinks, "impulse");
        run.job.scales.slope = number(sinks, "slope");
        run.job.scales.residence = number(sinks, "residence");
        run.job.scales.moment = number(sinks, "moment");
    }
    if (sinks.contains("heat")) {
        run.heat = data<int64_t>(sinks, "heat", n * 2);
        run.job.with_heat_sinks = true;
        run.job.scales.heat_scale = number(sinks, "heat_scale");
        run.job.scales.heat_slope = number(sinks, "heat_slope");
    }
    if (sinks.contains("pairs")) {
        const size_t materials = capacity.size();
        run.pairs = data<int64_t>(sinks, "pairs", materials * n * kernel::PAIRS);
        run.job.with_pairs = true;
        run.job.scales.number = number(sinks, "number");
        run.job.scales.pair_moment = number(sinks, "pair_moment");
        run.job.scales.pair_square = number(sinks, "pair_square");
        run.job.scales.events = number(sinks, "events");
        run.job.scales.pair_mass = number(sinks, "pair_mass");
        run.job.partners.materials = (int)materials;
        run.job.partners.rows = data<float>(sinks, "partners", materials * n * kernel::PARTNER);
        run.job.partners.diameter = data<double>(sinks, "partner_diameter", materials * kernel::PARTNER_SIZES);
        run.job.partners.density = data<double>(sinks, "partner_density", materials);
        run.job.options.pair_restitution = number(sinks, "pair_restitution");
        run.job.options.pair_friction = number(sinks, "pair_friction");
        run.job.options.pair_correlation = number(sinks, "pair_correlation");
        run.job.options.pair_share = number(sinks, "pair_share");
    }
    run.impacts = impacts;
    run.job.with_impacts = impacts != nullptr;
    return run;
}

nb::tuple advance(const Grid& grid, nb::dict geometry, nb::dict gas, nb::dict options, nb::dict cloud,
                  nb::dict sinks, Impacts* impacts, const std::string& name, int threads, int64_t first,
                  double seconds) {
    const Run run = run_of(grid, geometry, gas, options, cloud, sinks, impacts);
    const kernel::Advance function = variant(name);
    kernel::Counts counts;
    int64_t next;
    {
        nb::gil_scoped_release released;
        next = work(run, function, std::max(threads, 1), first, seconds, counts);
    }
    const bool done = next * kernel::CHUNK >= run.job.cloud.count;
    return nb::make_tuple(done ? -1 : next, counts.steps, counts.bounces, counts.strays,
                          counts.collisions);
}

// impacts by id and step, as one array of doubles: id, step, bounce, x, v, normal, time
nb::ndarray<nb::numpy, double, nb::ndim<2>> sorted(Impacts& impacts) {
    auto& all = impacts.records;
    std::sort(all.begin(), all.end(), [](const auto& a, const auto& b) {
        return std::tie(a.id, a.step, a.bounce) < std::tie(b.id, b.step, b.bounce);
    });
    constexpr size_t width = 13;
    auto* values = new double[all.size() * width + 1];
    nb::capsule owner(values, [](void* p) noexcept { delete[] static_cast<double*>(p); });
    for (size_t i = 0; i < all.size(); ++i) {
        double* row = values + i * width;
        const auto& r = all[i];
        row[0] = (double)r.id, row[1] = r.step, row[2] = r.bounce;
        for (int j = 0; j < 3; ++j) row[3 + j] = r.x[j], row[6 + j] = r.v[j], row[9 + j] = r.normal[j];
        row[12] = r.time;
    }
    return nb::ndarray<nb::numpy, double, nb::ndim<2>>(values, {all.size(), width}, owner);
}

}  // namespace

NB_MODULE(_kernel, m) {
    m.doc() = "Compiled kernel of the particle tracker; fem_tfm.models.particles is its face.";
    m.attr("ROW") = kernel::ROW;
    m.attr("SUMS") = kernel::SUMS;
    m.attr("FACE") = kernel::FACE;
    m.attr("PAIRS") = kernel::PAIRS;
    m.attr("PARTNER") = kernel::PARTNER;
    m.attr("PARTNER_SIZES") = kernel::PARTNER_SIZES;
    m.attr("CHUNK") = kernel::CHUNK;
    m.attr("AWAY") = (int)kernel::AWAY;
    m.attr("DRAG_FIRST") = kernel::DRAG_FIRST;
    m.attr("DRAG_OCTAVES") = kernel::DRAG_OCTAVES;
    m.attr("DRAG_PIECES") = kernel::DRAG_PIECES;
    m.attr("VARIANT") = has_avx512() ? "avx512" : has_avx2() ? "avx2" : "plain";
    nb::class_<Grid>(m, "Grid")
        .def(nb::init<int, nb::dict, int, int>(), "cells"_a, "arrays"_a, "nodes"_a, "folds"_a);
    nb::class_<Impacts>(m, "Impacts").def(nb::init<>()).def("sorted", &sorted);
    m.def("advance", &advance, "grid"_a, "geometry"_a, "gas"_a, "options"_a, "cloud"_a, "sinks"_a,
          "impacts"_a.none(), "variant"_a, "threads"_a, "first"_a, "seconds"_a);
    nb::module_ grains = m.def_submodule("grains", "Grains as discrete elements; fem_tfm.models.slug is their face.");
    fem_tfm::grains::bind_grains(grains);
}
