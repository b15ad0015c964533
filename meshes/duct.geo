// SPDX-License-Identifier: LGPL-3.0-or-later
//
// Cross-section of a rectangular duct, or the duct itself (length > 0), cells graded to the walls.
// The section lies in the plane (x, y), y up, z downstream, centre at the origin.
// Open it in Gmsh as it is, or set any constant: gmsh -2 -setnumber size 1e-4 duct.geo

DefineConstant[
  width = {0.01, Min 1e-6, Name "Duct/1Width, along x [m]"},
  height = {0.01, Min 1e-6, Name "Duct/2Height, along y [m]"},
  wall_offset = {0, Min 0, Name "Duct/3Distance of the mesh from the wall [m]"},
  quadrants = {2, Choices{1="quarter: x, y >= 0", 2="half: x >= 0", 4="whole"}, Name "Duct/4Part"},
  length = {0, Min 0, Name "Duct/5Length [m], 0 for the section alone"},
  size = {1.125e-3, Min 1e-9, Name "Mesh/1Cell size in the core [m]"},
  wall_ratio = {0.25, Min 1e-4, Max 1, Name "Mesh/2Thickness of the wall cell over the core size"},
  quads = {0, Choices{0, 1}, Name "Mesh/3Quadrilaterals"},
  order = {2, Choices{1, 2}, Name "Mesh/4Order of the geometry"},
  axial_layers = {10, Min 1, Step 1, Name "Mesh/5Cells along the length"}
];

half() = {width / 2 - wall_offset, height / 2 - wall_offset};

// Cells of a half side: as many as a size linear in the wall distance gives; the size is fitted to the
// shorter side. Their growth by bisection: wall_size (1 + g + ... + g^(cells - 1)) = half side.
wanted = 1;
If (wall_ratio < 1 - 1e-6)
  wanted = Log(1 / wall_ratio) / (1 - wall_ratio);
EndIf
shorter = (half(0) < half(1)) ? half(0) : half(1);
fitted = (wanted * shorter > 1.5 * size) ? Round(wanted * shorter / size) : 1;
core_size = wanted * shorter / fitted;
wall_size = wall_ratio * core_size;
For i In {0:1}
  cells(i) = Ceil(wanted * half(i) / core_size - 1e-3);
  lower = 1e-2;
  upper = 1e2;
  For step In {1:60}
    growth(i) = Sqrt(lower * upper);
    sum = 0;
    For j In {0:cells(i)-1}
      sum += wall_size * growth(i)^j;
    EndFor
    If (sum > half(i))
      upper = growth(i);
    Else
      lower = growth(i);
    EndIf
  EndFor
EndFor

// Blocks of one quadrant, mirrored; point 10 + 3 row + column of a three by three lattice.
first_column = (quadrants == 4) ? 0 : 1;
first_row = (quadrants == 1) ? 1 : 0;
For row In {first_row:2}
  For column In {first_column:2}
    Point(10 + 3 * row + column) = {(column - 1) * half(0), (row - 1) * half(1), 0};
  EndFor
EndFor
For row In {first_row:2}
  For column In {first_column:1}
    p = 10 + 3 * row + column;
    Line(10 + p) = {p, p + 1};
    Transfinite Curve {10 + p} = cells(0) + 1 Using Progression (column == 0) ? growth(0) : 1 / growth(0);
  EndFor
EndFor
For row In {first_row:1}
  For column In {first_column:2}
    p = 10 + 3 * row + column;
    Line(20 + p) = {p, p + 3};
    Transfinite Curve {20 + p} = cells(1) + 1 Using Progression (row == 0) ? growth(1) : 1 / growth(1);
  EndFor
EndFor

// Diagonals point to the corners of the duct: no triangle has both its edges on walls.
For row In {first_row:1}
  For column In {first_column:1}
    p = 10 + 3 * row + column;
    Curve Loop(p) = {10 + p, 21 + p, -(13 + p), -(20 + p)};
    Plane Surface(p) = {p};
    If (row == column)
      Transfinite Surface {p} = {p, p + 1, p + 4, p + 3} Right;
    Else
      Transfinite Surface {p} = {p, p + 1, p + 4, p + 3} Left;
    EndIf
  EndFor
EndFor

Include "common.geo";
