// SPDX-License-Identifier: LGPL-3.0-or-later
// Grains as an object: memory of the state, what comes in and goes out, and the steps.
#pragma once

#include <cstdint>
#include <vector>

#include "grains_state.hpp"

namespace fem_tfm::grains {

constexpr int ROW = 18 + 4 * SLOTS;

class Grains {
  public:
    Grains();
    ~Grains();
    Grains(const Grains&) = delete;
    Grains& operator=(const Grains&) = delete;

    State s{};

    // Append grains; x and v are (count, 3), the others (count).
    void add(int count, const double* x, const double* v, const double* radius, const double* mass,
             const std::uint8_t* held, const std::int64_t* id);
    // Take out the grains beyond a place z along the axis; their numbers are returned in the order of the arrays.
    std::vector<std::int64_t> remove_beyond(double z);
    // False where a place is no longer finite.
    bool run(int steps);
    void set_threads(int threads);
    // Triangles (count, 9) that take the place of tube, duct and ends; none where count is 0.
    void set_surface(int count, const double* corners);
    // Arc in the axis of a bent tube: normal towards its centre, radius, angle, length before it.
    void set_arc(const double* normal, double radius, double angle, double before);
    // Impacts since the last call, rows of IMPACT numbers by blocks of grains.
    std::vector<double> take_impacts();
    // Walls, arc, sizes or skin have changed: how far apart neighbours are along the axis.
    void stretch();
    // Law, walls or sizes have changed.
    void refresh();
    // Forget springs, list and grains.
    void clear();
    // Number of grains and pairs for a state that is about to be filled in.
    void resize(int n, int room, int spill_room);
    // Take out the grains that are flagged.
    void take_out(const std::uint8_t* leaves);
    // Rows of ROW numbers of some grains: place, motion, force, springs at walls, number and mark.
    std::vector<double> some(const std::vector<int>& which) const;
    void append(int count, const double* rows);
    // Springs of pairs by the numbers of their grains; those of grains that are not here are dropped.
    void keep_pairs(int count, const std::int64_t* pairs, const double* shear);
    void finish_restore();
    // Take the springs out of a list that is no longer valid.
    void keep_springs();

  private:
    std::vector<double> corners_;
    void reserve(int n);
};

// Instruction sets that this machine can run, best first; and the choice among them.
std::vector<const char*> instruction_sets();
void use(const char* name);
const char* used();

}  // namespace fem_tfm::grains
