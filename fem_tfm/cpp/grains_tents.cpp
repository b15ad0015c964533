// SPDX-License-Identifier: LGPL-3.0-or-later
#include "grains_tents.hpp"

#include <algorithm>
#include <cmath>

namespace fem_tfm::grains {
namespace {

#include "grains_arc.hpp"

constexpr double PI = 3.14159265358979323846;
constexpr int ITERATIONS = 20;
constexpr double CLOSE = 1e-15;

// Point of the reference square that a quadrilateral maps to (x, y), by Newton's method.
bool invert(const double* c, double x, double y, double& xi, double& eta) {
    const double ax = c[2] - c[0], ay = c[3] - c[1], bx = c[4] - c[0], by = c[5] - c[1];
    const double mx = c[6] - c[4] - ax, my = c[7] - c[5] - ay;
    xi = eta = 0.5;
    for (int k = 0; k < ITERATIONS; ++k) {
        const double fx = c[0] + ax * xi + bx * eta + mx * xi * eta - x;
        const double fy = c[1] + ay * xi + by * eta + my * xi * eta - y;
        const double px = ax + mx * eta, py = ay + my * eta, qx = bx + mx * xi, qy = by + my * xi;
        const double det = px * qy - py * qx;
        if (det == 0.0) return false;
        const double dxi = (fx * qy - fy * qx) / det, deta = (fy * px - fx * py) / det;
        xi -= dxi, eta -= deta;
        if (std::abs(dxi) + std::abs(deta) < CLOSE) return true;
    }
    return std::isfinite(xi) && std::isfinite(eta);
}

}  // namespace

Tents::Tents(std::vector<double> corners, std::vector<int> nodes, std::vector<double> planes)
    : corners_(std::move(corners)), planes_(std::move(planes)), nodes_(std::move(nodes)) {
    for (int n : nodes_) per_plane_ = std::max(per_plane_, n + 1);
    const double top = HUGE_VAL;
    for (std::size_t q = 0; q < nodes_.size() / 4; ++q) {
        double box[4] = {top, top, -top, -top};
        for (int k = 0; k < 4; ++k)
            for (int d = 0; d < 2; ++d) {
                box[d] = std::min(box[d], corners_[8 * q + 2 * k + d]);
                box[2 + d] = std::max(box[2 + d], corners_[8 * q + 2 * k + d]);
            }
        box_.insert(box_.end(), box, box + 4);
    }
}

void Tents::in_section(double x, double y, int& quad, double& xi, double& eta) const {
    double best = HUGE_VAL;
    for (int pass = 0; pass < 2 && best > 1e-9; ++pass)
        for (int q = 0; q < int(nodes_.size() / 4); ++q) {
            const double* b = &box_[4 * q];
            // a grain that the wall has let in a little is looked for everywhere
            if (pass == 0 && (x < b[0] || x > b[2] || y < b[1] || y > b[3])) continue;
            double a, c;
            if (!invert(&corners_[8 * q], x, y, a, c)) continue;
            const double out = std::max(std::max(-a, a - 1.0), std::max(-c, c - 1.0));
            if (out >= best) continue;
            best = out, quad = q;
            xi = std::min(std::max(a, 0.0), 1.0), eta = std::min(std::max(c, 0.0), 1.0);
            if (best <= 0.0) return;
        }
}

void Tents::locate(const State& s) {
    const int n = s.n;
    const double* place = s.x;
    node.assign(8 * std::size_t(n), -1), weight.assign(8 * std::size_t(n), 0.0);
    volume.resize(n);
    const double low = planes_.front(), high = planes_.back();
    const double per = (double(planes_.size()) - 1.0) / (high - low);
    for (int i = 0; i < n; ++i) {
        const double r = place[4 * i + 3];
        double at[3] = {place[4 * i], place[4 * i + 1], place[4 * i + 2]};
        if (s.walls.kind == BENT) straighten(s.arc, place + 4 * i, at);
        const double x = at[0], y = at[1], z = at[2];
        volume[i] = 4.0 / 3.0 * PI * r * r * r;
        if (s.marks[i] & GHOST) continue;
        if (!(z >= low && z <= high)) continue;
        int quad = -1;
        double xi = 0.0, eta = 0.0;
        in_section(x, y, quad, xi, eta);
        if (quad < 0) continue;
        const int last = int(planes_.size()) - 2;
        int layer = std::min(int((z - low) * per), last);
        while (layer > 0 && z < planes_[layer]) --layer;
        while (layer < last && z > planes_[layer + 1]) ++layer;
        const double zeta = (z - planes_[layer]) / (planes_[layer + 1] - planes_[layer]);
        const double share[4] = {(1.0 - xi) * (1.0 - eta), xi * (1.0 - eta), (1.0 - xi) * eta, xi * eta};
        for (int k = 0; k < 4; ++k) {
            node[8 * i + k] = layer * per_plane_ + nodes_[4 * quad + k];
            node[8 * i + 4 + k] = node[8 * i + k] + per_plane_;
            weight[8 * i + k] = share[k] * (1.0 - zeta), weight[8 * i + 4 + k] = share[k] * zeta;
        }
    }
}

void Tents::deposit(const double* motion, double* solids, double* momentum) const {
    for (std::size_t i = 0; i < volume.size(); ++i)
        for (int k = 0; k < 8 && node[8 * i] >= 0; ++k) {
            const double share = volume[i] * weight[8 * i + k];
            const int j = node[8 * i + k];
            solids[j] += share;
            for (int d = 0; d < 3; ++d) momentum[3 * j + d] += share * motion[8 * i + d];
        }
}

void Tents::pull(const double* field, double* force) const {
    for (std::size_t i = 0; i < volume.size(); ++i) {
        double f[3] = {0.0, 0.0, 0.0};
        for (int k = 0; k < 8 && node[8 * i] >= 0; ++k)
            for (int d = 0; d < 3; ++d) f[d] += weight[8 * i + k] * field[3 * node[8 * i + k] + d];
        for (int d = 0; d < 3; ++d) force[4 * i + d] = volume[i] * f[d];
    }
}

}  // namespace fem_tfm::grains
