// SPDX-License-Identifier: LGPL-3.0-or-later
//
// What the sections share: quadrilaterals, extrusion, names of the parts, options. Included by the others,
// which set quadrants, length, quads, order, axial_layers and leave all surfaces of the section behind.

If (quads)
  Recombine Surface {:};
EndIf
If (length > 0)
  section() = Surface {:};
  If (quads)
    Extrude {0, 0, length} { Surface{section()}; Layers{axial_layers}; Recombine; }
  Else
    Extrude {0, 0, length} { Surface{section()}; Layers{axial_layers}; }
  EndIf
EndIf

// The wall is what is left of the boundary when the planes are taken out.
huge = 1e3;
thin = 1e-9;
If (length > 0)
  wall() = Abs(CombinedBoundary{ Volume{:}; });
  inlet() = Surface In BoundingBox {-huge, -huge, -thin, huge, huge, thin};
  outlet() = Surface In BoundingBox {-huge, -huge, length - thin, huge, huge, length + thin};
  plane_x() = Surface In BoundingBox {-thin, -huge, -huge, thin, huge, huge};
  plane_y() = Surface In BoundingBox {-huge, -thin, -huge, huge, thin, huge};
  wall() -= inlet();
  wall() -= outlet();
Else
  wall() = Abs(CombinedBoundary{ Surface{:}; });
  plane_x() = Curve In BoundingBox {-thin, -huge, -huge, thin, huge, huge};
  plane_y() = Curve In BoundingBox {-huge, -thin, -huge, huge, thin, huge};
EndIf
If (quadrants < 4)
  wall() -= plane_x();
EndIf
If (quadrants < 2)
  wall() -= plane_y();
EndIf

If (length > 0)
  Physical Volume("fluid", 1) = Volume {:};
  Physical Surface("wall", 2) = wall();
  If (quadrants == 1)
    Physical Surface("symmetry_x", 3) = plane_x();
    Physical Surface("symmetry_y", 4) = plane_y();
  ElseIf (quadrants == 2)
    Physical Surface("symmetry", 3) = plane_x();
  EndIf
  Physical Surface("inlet", 5) = inlet();
  Physical Surface("outlet", 6) = outlet();
Else
  Physical Surface("fluid", 1) = Surface {:};
  Physical Curve("wall", 2) = wall();
  If (quadrants == 1)
    Physical Curve("symmetry_x", 3) = plane_x();
    Physical Curve("symmetry_y", 4) = plane_y();
  ElseIf (quadrants == 2)
    Physical Curve("symmetry", 3) = plane_x();
  EndIf
EndIf

Mesh.ElementOrder = order;
Mesh.SecondOrderIncomplete = 0;
