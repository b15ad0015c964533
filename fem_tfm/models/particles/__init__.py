# SPDX-License-Identifier: LGPL-3.0-or-later
"""Particles carried by a gas: the cells they move through, the cloud, and the tracker."""
