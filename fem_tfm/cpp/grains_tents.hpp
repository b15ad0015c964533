// SPDX-License-Identifier: LGPL-3.0-or-later
// Grains in the mesh of a line: the nodal basis functions at their places. In a bend they are those of
// the straight line, from which the mesh is bent.
//
// The mesh is a section of quadrilaterals times layers along z. Its nodes are numbered layer by layer:
// node = layer * nodes of the section + node of the section.
#pragma once

#include <vector>

#include "grains_state.hpp"

namespace fem_tfm::grains {

class Tents {
  public:
    // corners (count, 4, 2) in the order (0,0) (1,0) (0,1) (1,1), their section nodes (count, 4),
    // heights of the layers' planes
    Tents(std::vector<double> corners, std::vector<int> nodes, std::vector<double> planes);

    int per_plane() const { return per_plane_; }
    int node_count() const { return per_plane_ * int(planes_.size()); }

    // Find the grains, rows of (x, y, z, radius), One outside the section gets the weights of the nearest
    // point; one before the first plane or behind the last gets none.
    // Grains that another process moves get none either.
    void locate(const State& s);
    // Add volume and volume times velocity of the grains to their nodes, in their order.
    void deposit(const double* motion, double* volume, double* momentum) const;
    // force of a grain = its volume times the sum of weight and nodal vector (nodes, 3)
    void pull(const double* field, double* force) const;

    std::vector<int> node;       // (n, 8), -1 where there is none
    std::vector<double> weight;  // (n, 8)
    std::vector<double> volume;  // (n)

  private:
    void in_section(double x, double y, int& quad, double& xi, double& eta) const;

    std::vector<double> corners_, planes_;
    std::vector<int> nodes_;
    std::vector<double> box_;  // (count, 4)
    int per_plane_ = 0;
};

}  // namespace fem_tfm::grains
