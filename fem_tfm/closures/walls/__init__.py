# SPDX-License-Identifier: LGPL-3.0-or-later
"""Wall laws of the solids and of the gas, and the wall functions of the Reynolds stresses."""
