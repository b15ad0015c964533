# SPDX-License-Identifier: LGPL-3.0-or-later
"""What a tube tells: averages over slices, slugs in them, sections across."""
