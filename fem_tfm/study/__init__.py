# SPDX-License-Identifier: LGPL-3.0-or-later
"""Studies over a case: sweeps of its values and sensitivities to its numbers."""
