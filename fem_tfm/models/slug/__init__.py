# SPDX-License-Identifier: LGPL-3.0-or-later
"""The slug tube: grains as discrete elements, the gas as a pressure field on the tube's mesh."""
