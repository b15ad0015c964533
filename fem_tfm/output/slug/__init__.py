# SPDX-License-Identifier: LGPL-3.0-or-later
"""Files, pictures and the film of a tube of grains."""
