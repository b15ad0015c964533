// SPDX-License-Identifier: LGPL-3.0-or-later
//
// The kernel for one instruction set; KERNEL_NAMESPACE is given on the command line.
#include "advance.h"
