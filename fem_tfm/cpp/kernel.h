// SPDX-License-Identifier: LGPL-3.0-or-later
//
// Plain data that Python, the threads and the compiled variants of the kernel share.
//
// A cloud is advanced in chunks of fixed size, and every particle by itself: nothing depends on the
// order of particles, on threads or on ranks. Sums are fixed-point integers for the same reason.
#pragma once

#include <cstdint>

namespace kernel {

constexpr int CHUNK = 1024;
// floats of the row of a node
constexpr int ROW = 16;
enum Field : int {
    VELOCITY = 0,       // U, V, W
    RATE = 3,           // 1/T_L
    TIME = 4,           // T_L
    FACTOR = 5,         // L11 L21 L22 L31 L32 L33, R = L L^T
    STRIP = 11,         // 1/(kappa u+) of the log law between plane and wall
    TEMPERATURE = 12,
    PRESSURE = 13,      // grad p/rho
};

// doubles of a triangle of the boundary
constexpr int FACE = 14;

enum class Cells : int { quadrilateral, triangle, tetrahedron, hexahedron };
enum class Wall : int { none, rectangle, circle, planes, bent_rectangle, bent_circle };
enum class Dispersion : int { none, langevin, eddies };
enum class Impact : int { elastic, restitution, stick };
// a particle that is AWAY is given back in the middle of the search for its cell, see Cloud::search
enum Status : int8_t { INSIDE = 0, OUT = 1, DEPOSITED = 2, LOST = 3, STUCK = 4, AWAY = 5 };

// Nodes of a cell in the kernel's order, its facets, and the floats of the row of a cell: origin in two
// parts an axis, inverse of the Jacobian at its centre, coefficients of the map of a cell that is not
// affine.
struct Layout {
    int nodes, facets, dim, map;
};
constexpr Layout layout_of(Cells cells) {
    return cells == Cells::quadrilateral ? Layout{9, 4, 2, 24}
           : cells == Cells::triangle    ? Layout{6, 3, 2, 24}
           : cells == Cells::tetrahedron ? Layout{4, 4, 3, 16}
                                         : Layout{8, 6, 3, 48};
}

struct Grid {
    Cells cells;
    int count, nodes;
    const int32_t* node;       // (count, nodes of a cell)
    // (count, facets of a cell): -1 at the boundary, -2 - j where ghost j of another rank follows
    const int32_t* neighbour;
    const float* map;          // (count, floats of the row)
    const uint8_t* curved;     // (count,) whether a cell is not affine
    bool any_curved;
    // triangles of the boundary near each cell: where a cell's list starts (count + 1), their numbers,
    // and for each its normal out, offset, vertices and kind (1 wall, 2 open), FACE doubles
    const int32_t *near_start, *near;
    const double* face;
    int folds;  // 0 whole, 1 about x = 0, 2 about x = 0 and y = 0
};

struct Geometry {
    Wall wall = Wall::none;
    double half[2] = {0, 0};  // half width and height of a rectangle; radius first for a circle
    double strip = 0;         // distance of the mesh from the wall
    // arc of a bent line: straight before, then radius and angle, normal towards its centre
    double before = 0, radius = 0, angle = 0, normal[2] = {0, 1};
    double length = 0;  // along the axis, beyond which a particle is out; 0 for no end
};

struct Gas {
    const float* rows[2] = {nullptr, nullptr};  // (nodes, ROW) at z0, and at z1 of a slab
    double z[2] = {0, 0};                       // or two times
    double density = 1, viscosity = 1e-5;
    double conductivity = 0, heat_capacity = 1;  // of the gas
};

// fixed-point sums, each absent if null; scale = 1/quantum
struct Sinks {
    int64_t* sums = nullptr;   // (cells, SUMS)
    int64_t* heat = nullptr;   // (cells, 2)
    int64_t* pairs = nullptr;  // (materials, cells, PAIRS)
    double impulse = 0, slope = 0, residence = 0, moment = 0, heat_scale = 0, heat_slope = 0;
    double number = 0, pair_moment = 0, pair_square = 0, events = 0, pair_mass = 0;
};
// numbers of particles: times in the cell, times velocity x y z, times its squares, collisions, mass
constexpr int PAIRS = 9;
constexpr int SUMS = 8;  // impulse x y z, slope, residence, moment x y z

struct ImpactRecord {
    int64_t id;
    uint32_t step, bounce;
    int32_t index;
    double x[3], v[3], normal[3], time;
};

struct Cloud {
    int64_t count;
    const int64_t* id;
    const int32_t* material;
    double *x, *v, *omega;
    float* xi;
    double *temperature, *time;
    int32_t* cell;
    uint32_t* step;
    int8_t* status;
    const double *rate, *diameter, *density;
    uint32_t* bounces;
    float* memory;  // (n, 5): gas velocity seen at the end of the step, drag rate B, next step
    // (n, 2): moves so far of a search that was broken off, steps since the call began. The cell of
    // what is AWAY is -2 - j at ghost j, where the search goes on, or -1 for a stray.
    int32_t* search;
};

// What a particle may meet in a cell, (materials, cells, PARTNER): number a volume, mean velocity,
// its standard deviation, mean diameter. The diameters of each material are drawn from PARTNER_SIZES.
constexpr int PARTNER = 8, PARTNER_SIZES = 64;
struct Partners {
    const float* rows = nullptr;
    const double *diameter = nullptr, *density = nullptr;
    int materials = 0;
};

// drag factor C_D Re/24 in pieces, cubic in Re: octaves of 2^FIRST .. 2^(FIRST + OCTAVES)
constexpr int DRAG_FIRST = -20, DRAG_OCTAVES = 40, DRAG_PIECES = 16;
constexpr int DRAG_ROWS = DRAG_OCTAVES * DRAG_PIECES;

struct Options {
    uint64_t seed = 0;
    // forces
    double gravity[3] = {0, 0, 0};
    bool buoyancy = true;
    bool pressure = false, saffman = false, magnus = false, heat = false;
    double added_mass = 0;
    const float* drag = nullptr;  // (materials, DRAG_ROWS, 4)
    const double* heat_capacity = nullptr;  // (materials)
    // dispersion
    Dispersion dispersion = Dispersion::none;
    double crossing = 0;  // beta of Csanady, 0 for none
    double inertia = 1;   // c of 1/(1 + c tau_p/T_L)
    // wall
    Impact impact = Impact::elastic;
    double restitution = 1, friction = 0, roughness = 0, stick_speed = 0;
    // collisions: restitution, friction, C of the correlation, largest share of the time between two,
    // 0 for none
    double pair_restitution = 1, pair_friction = 0, pair_correlation = 0, pair_share = 0;
    // steps
    double eddies = 1, relaxation = 1, cells = 1, largest = 4e-3, smallest = 1e-7;
    int64_t max_steps = 1000000;
    // end
    bool until_time = false;
    double end = 0;
};

struct Job {
    Grid grid;
    Geometry geometry;
    Gas gas;
    Options options;
    Cloud cloud;
    Partners partners;
    bool with_sinks = false, with_heat_sinks = false, with_impacts = false, with_pairs = false;
    Sinks scales;
};

struct Counts {
    int64_t steps = 0, bounces = 0, strays = 0, collisions = 0;
};

// what one thread writes
struct Output {
    Sinks sinks;
    Counts counts;
    void (*record)(void*, const ImpactRecord&) = nullptr;
    void* records = nullptr;
};

using Advance = void (*)(const Job&, int64_t begin, int64_t end, Output&);

}  // namespace kernel
