// SPDX-License-Identifier: LGPL-3.0-or-later
// What the grains' kernel holds: plain arrays, laws and walls.
//
// grains_step.cpp is compiled once for every instruction set and sees only this header, so that no
// inline function of the standard library can be shared between instruction sets.
//
// Grains are sorted by cells along z. Blocks of BLOCK grains are the unit of work: what a block does
// depends on no thread count, hence the bits of a result do not either.
#pragma once

#include <cstddef>
#include <cstdint>

namespace fem_tfm::grains {

constexpr int BLOCK = 256;
// rows behind the last grain that vector code may read
constexpr int PAD = 8;
// a grain touches at most the tube or two pairs of plane walls, and one end: slots of wall springs
constexpr int SLOTS = 3;

enum LawKind { VISCOUS = 0, SPRING = 1, HERTZ = 2 };
enum WallKind { OPEN = 0, ROUND = 1, RECTANGULAR = 2, BENT = 3 };
// mark of a grain that another process moves
constexpr std::uint8_t GHOST = 128;
// numbers of an impact: place of the contact, speed, speed along the normal, mass and radius of the
// grain, number of the grain
constexpr int IMPACT = 8;

// Coefficients of a contact law, see fem_tfm/closures/contacts.py.
//   normal stiffness S = kn, or 3/2 kn sqrt(R d) for Hertz, whose force is kn sqrt(R) d^(3/2)
//   normal damping   gn = cn sqrt(m S)
//   tangential stiffness T = kt, or kt sqrt(R d)
//   tangential damping   gt = ct sqrt(m S) for VISCOUS, ct sqrt(m T) else
//   friction mu, rolling friction mr, limited by the damping cr sqrt(m S)
struct Law {
    double kn, cn, kt, ct, mu, mr, cr;
};

struct Walls {
    int kind;
    double radius, half_width, half_height;
    // plane walls at z = low and z = high
    int low_closed, high_closed;
    double low, high;
};

// Arc in the axis of a tube, see fem_tfm/geometry/arc.py. What is `along` reach at the axis may be
// `stretch` times as far apart there as it is inside.
struct Arc {
    double normal[2], radius, angle, before, cosine, sine, stretch;
};

// Impacts on walls that the grains of a block have had since they were read.
struct Log {
    double* row;
    int count, room;
};

// Cells of the neighbour list: boxes of the reach, or slices of which `layers` span it.
struct Cells {
    double low[3], size[3];
    int count[3], layers;
};

struct Boxes;

struct State {
    int n, capacity;
    int law_kind, mono, rolling;
    Law pair, wall;
    Walls walls;
    Arc arc;
    double dt, gravity[3];
    double skin, largest, release;
    int threads, recording, watching;

    double* x;        // (n, 4) place and radius
    double* v;        // (n, 8) velocity, 1/m; radius times spin, 1/m where the grain is free, else 0
    double* force;    // (n, 4) force from outside, kept over steps
    double* spring[SLOTS];  // (n, 4) tangential springs at walls
    std::uint8_t* pressed;  // (n, SLOTS) whether the springs of W grains from a first one may be loaded
    double* record;   // (n, 8) force of walls, its normal part, force of other grains
    std::uint8_t* marks;    // (n) GHOST, and the bit of each slot whose wall was touched in the last step, if watched
    Log* log;               // of each block
    std::int64_t* id;
    double* origin;   // (n, 4) places at the last rebuild
    double* straight; // (n, 4) those in the straight line, where the tube is bent
    double* spare;    // (n, 12) room for sorting
    double* column;   // (4, n) places and radii by component, at a rebuild
    int *cell, *order;

    // neighbour list: pairs i < j, grouped by i, a region of `room` pairs for each block
    int room;
    int *first, *second;
    double* shear;          // (pairs, 4) tangential springs
    std::uint8_t* touching; // 255 where a pair with a spring is in contact
    int *begin, *amount;    // of each grain
    int *pairs;             // of each block, those that are listed
    int *reach;             // of each block, grains behind its end that its pairs push
    double* spill;          // (blocks, spill_room, 8 or 12) what they push with
    int spill_room;
    int* kept;              // (2, pairs) and
    double* kept_shear;     // (pairs, 4): springs in contact while a list is made
    int kept_count;         // how many, -1 where they are still in the list
    int overflow;           // room that a block lacks
    Cells cells;
    // shares of the threads: blocks cut[t] to cut[t + 1], of which the first late[t] move late
    int *cut, *late;
    int phase, arrived, asleep;  // of the threads' meetings
    double** bench;         // room of each share
    std::size_t bench_pushes;
    int bench_pairs;
    double* speed;          // (threads) squares of the largest speed
    int* slab;              // start of each cell
    int slab_room;
    int fresh;              // whether the list is valid
    double travelled;       // bound of what any grain has moved since the list was made
    // triangles of a surface that grains do not pass, (triangles, 9), and those within the reach of
    // each grain
    int triangles;
    const double* corner;
    int *near_begin, *near;
    Boxes* boxes;    // space cut into boxes with their triangles, for the reach of
    double boxes_reach;
    // counters
    std::int64_t steps, rebuilds, contacts;
    int failed;             // 1: a place is not finite
    double fastest;         // of the last step [m/s]
};

// Reserve more memory; these are compiled for the baseline.
void reserve_pairs(State& s, int room);
void reserve_spill(State& s, int room);
void reserve_slabs(State& s, int room);
// room of every share: `pushes` numbers of pushes and `pairs` packed contacts
void reserve_benches(State& s, std::size_t pushes, int pairs);

// Add an impact to the log of a block; the threads do it, each for its own blocks.
void log_impact(State& s, int block, const double* row);

// Find the triangles near each grain's place of the last rebuild.
void list_surface(State& s);

using Run = void (*)(State&, int steps);

}  // namespace fem_tfm::grains
