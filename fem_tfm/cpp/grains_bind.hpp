// SPDX-License-Identifier: LGPL-3.0-or-later
#pragma once

#include <nanobind/nanobind.h>

namespace fem_tfm::grains {

// Add the grains' functions and classes to a module.
void bind_grains(nanobind::module_& module);

}  // namespace fem_tfm::grains
