// SPDX-License-Identifier: LGPL-3.0-or-later
//
// Cross-section of a round pipe, or the pipe itself (length > 0).
// The section lies in the plane (x, y), y up, z downstream, centre at the origin.
// Open it in Gmsh as it is, or set any constant: gmsh -2 -setnumber size 1e-4 pipe.geo

DefineConstant[
  diameter = {0.01, Min 1e-6, Name "Pipe/1Diameter [m]"},
  quadrants = {2, Choices{1="quarter: x, y >= 0", 2="half: x >= 0", 4="whole"}, Name "Pipe/2Part"},
  length = {0, Min 0, Name "Pipe/3Length [m], 0 for the section alone"},
  size = {6.25e-4, Min 1e-9, Name "Mesh/1Cell size in the core [m]"},
  wall_ratio = {0.25, Min 1e-4, Max 1, Name "Mesh/2Thickness of the wall cell over the core size"},
  layout = {0, Choices{0="o-grid", 1="free", 2="blocks", 3="block"}, Name "Mesh/3Layout"},
  quads = {0, Choices{0, 1}, Name "Mesh/4Quadrilaterals"},
  order = {2, Choices{1, 2}, Name "Mesh/5Order of the geometry"},
  axial_layers = {10, Min 1, Step 1, Name "Mesh/6Cells along the length"}
];

radius = diameter / 2;

// Directions are multiples of 45 degrees, from the first axis of the part; the whole one closes on itself.
first_angle = (quadrants == 1) ? 0 : -Pi / 2;
sectors = 2 * quadrants;
directions = (quadrants == 4) ? sectors : sectors + 1;
Point(1) = {0, 0, 0};

If (layout == 0)

  // The core is a bulged square, 120 degrees at its corners: curved edges cross the axes at core_axis
  // and meet on the diagonals at core_corner.
  core_axis = 0.5 * radius;
  core_corner = 0.625 * radius;
  n = (core_axis > 1.5 * size) ? Round(core_axis / size) : 1;
  core_size = core_axis / n;
  wall_size = wall_ratio * core_size;

  // Layers: as many as a cell size linear in the wall distance gives.
  gap_axis = radius - core_axis;
  gap_corner = radius - core_corner;
  wanted = 1;
  If (wall_ratio < 1 - 1e-6)
    wanted = Log(1 / wall_ratio) / (1 - wall_ratio);
  EndIf
  layers = Ceil(wanted * gap_axis / core_size - 1e-3);

  // Growth of the layer thickness, by bisection: wall_size (1 + g + ... + g^(layers - 1)) = gap.
  // A wall_size too thick for the gap shrinks the layers inwards (growth below one).
  lower_axis = 1e-2; upper_axis = 1e2;
  lower_corner = 1e-2; upper_corner = 1e2;
  For i In {1:60}
    growth_axis = Sqrt(lower_axis * upper_axis);
    growth_corner = Sqrt(lower_corner * upper_corner);
    sum_axis = 0; sum_corner = 0;
    For j In {0:layers-1}
      sum_axis += wall_size * growth_axis^j;
      sum_corner += wall_size * growth_corner^j;
    EndFor
    If (sum_axis > gap_axis)
      upper_axis = growth_axis;
    Else
      lower_axis = growth_axis;
    EndIf
    If (sum_corner > gap_corner)
      upper_corner = growth_corner;
    Else
      lower_corner = growth_corner;
    EndIf
  EndFor

  // Curve j (0 on the core, layers on the wall) is a chain of arcs, each centred on its own axis, so that
  // the mid-side nodes of every layer follow its curve: long thin cells keep an even thickness.
  r_axis = radius; r_corner = radius;
  For i In {0:layers}
    j = layers - i;
    If (i > 0)
      r_axis = (j == 0) ? core_axis : r_axis - wall_size * growth_axis^(i - 1);
      r_corner = (j == 0) ? core_corner : r_corner - wall_size * growth_corner^(i - 1);
    EndIf
    half_chord = r_corner / Sqrt(2);
    centre = 0;
    If (r_axis < r_corner * (1 - 1e-9))
      centre = (r_axis^2 - r_corner^2) / (2 * (r_axis - half_chord));
    EndIf
    For k In {0:directions-1}
      angle = first_angle + k * Pi / 4;
      r = (k % 2 == 0) ? r_axis : r_corner;
      Point(100 + 20 * j + k) = {r * Cos(angle), r * Sin(angle), 0};
      If (k % 2 == 0)
        Point(100 + 20 * j + 10 + k) = {centre * Cos(angle), centre * Sin(angle), 0};
      EndIf
    EndFor
    For k In {0:sectors-1}
      axis = (k % 2 == 0) ? k : (k + 1) % directions;
      Circle(100 + 20 * j + k) =
        {100 + 20 * j + k, 100 + 20 * j + 10 + axis, 100 + 20 * j + (k + 1) % directions};
      Transfinite Curve {100 + 20 * j + k} = n + 1;
    EndFor
  EndFor

  // Core: one block a quadrant, diagonals through the centre and the corner of the square.
  For k In {0:directions-1:2}
    Line(10 + k) = {1, 100 + k};
    Transfinite Curve {10 + k} = n + 1;
  EndFor
  For k In {0:sectors-1:2}
    next = (k + 2) % directions;
    Curve Loop(10 + k) = {10 + k, 100 + k, 101 + k, -(10 + next)};
    Plane Surface(10 + k) = {10 + k};
    Transfinite Surface {10 + k} = {1, 100 + k, 101 + k, 100 + next} Right;
  EndFor

  // Layers: one row of cells each, diagonals from the inner diagonal side to the outer axis side, so that
  // they mirror in the axes and no triangle has an edge on the wall and another on a plane of symmetry.
  For j In {0:layers-1}
    inner = 100 + 20 * j;
    outer = inner + 20;
    For k In {0:directions-1}
      Line(inner + 10 + k) = {inner + k, outer + k};
      Transfinite Curve {inner + 10 + k} = 2;
    EndFor
    For k In {0:sectors-1}
      next = (k + 1) % directions;
      Curve Loop(inner + k) = {inner + 10 + k, outer + k, -(inner + 10 + next), -(inner + k)};
      Plane Surface(inner + k) = {inner + k};
      If (k % 2 == 0)
        Transfinite Surface {inner + k} = {inner + k, outer + k, outer + next, inner + next} Left;
      Else
        Transfinite Surface {inner + k} = {inner + k, outer + k, outer + next, inner + next} Right;
      EndIf
    EndFor
  EndFor

ElseIf (layout == 2)

  // Blocks: one a quadrant, between its two axes and the wall, no layers. The coarsest has four cells.
  n = (radius > 1.5 * size) ? Round(radius / size) : 1;
  core_size = radius / n;
  wall_size = core_size;
  For k In {0:directions-1}
    angle = first_angle + k * Pi / 4;
    Point(100 + k) = {radius * Cos(angle), radius * Sin(angle), 0};
  EndFor
  For k In {0:sectors-1}
    Circle(100 + k) = {100 + k, 1, 100 + (k + 1) % directions};
    Transfinite Curve {100 + k} = n + 1;
  EndFor
  For k In {0:directions-1:2}
    Line(10 + k) = {1, 100 + k};
    Transfinite Curve {10 + k} = n + 1;
  EndFor
  For k In {0:sectors-1:2}
    next = (k + 2) % directions;
    Curve Loop(10 + k) = {10 + k, 100 + k, 101 + k, -(10 + next)};
    Plane Surface(10 + k) = {10 + k};
    Transfinite Surface {10 + k} = {1, 100 + k, 101 + k, 100 + next} Right;
  EndFor

ElseIf (layout == 3)

  // One quadrilateral, its corners between the axes; for a whole section alone.
  core_size = radius * Sqrt(2);
  wall_size = core_size;
  For k In {0:3}
    angle = first_angle + Pi / 4 + k * Pi / 2;
    Point(100 + k) = {radius * Cos(angle), radius * Sin(angle), 0};
  EndFor
  For k In {0:3}
    Line(100 + k) = {100 + k, 100 + (k + 1) % 4};
    Transfinite Curve {100 + k} = 2;
  EndFor
  Curve Loop(10) = {100, 101, 102, 103};
  Plane Surface(10) = {10};
  Transfinite Surface {10} = {100, 101, 102, 103};

Else

  // Free triangles, isotropic, their size linear in the distance from the wall.
  core_size = size;
  wall_size = wall_ratio * size;
  For k In {0:directions-1:2}
    angle = first_angle + k * Pi / 4;
    Point(100 + k) = {radius * Cos(angle), radius * Sin(angle), 0};
    Line(10 + k) = {1, 100 + k};
  EndFor
  For k In {0:sectors-1:2}
    next = (k + 2) % directions;
    Circle(100 + k) = {100 + k, 1, 100 + next};
    Curve Loop(10 + k) = {10 + k, 100 + k, -(10 + next)};
    Plane Surface(10 + k) = {10 + k};
  EndFor
  Field[1] = MathEval;
  Field[1].F = Sprintf("%.15f - %.15f * Sqrt(x * x + y * y)", size, (size - wall_size) / radius);
  Background Field = 1;
  Mesh.MeshSizeExtendFromBoundary = 0;
  Mesh.MeshSizeFromPoints = 0;

EndIf

Include "common.geo";
