// Hands a welded mesh to a sink.
#pragma once

#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

#include "query/march/vertex_attributes.h"
#include "query/mesh/scratch_mesh.h"
#include "query/mesh/weld.h"

namespace isonest::detail {

/// Without counts and box, as MeshSink::prepare() takes it. `corners`: of an element, 3 or 2.
MeshLayout layout_of(const AttributeChoice& attributes, int corners, std::optional<LengthUnit> unit,
                     AnatomicalFrame frame);

/// begin(), all batches as often as the sink asks for them, end(). `layout`: of prepare(). Of lines
/// ("triangles" whose last two corners are equal) and triangles. Throws what the sink throws, and
/// Error{cancelled}.
void emit_mesh(const PartStore& parts, const VertexNumbers& weld, MeshLayout layout, MeshSink& sink,
               Progress& progress);

/// All batches of these parts, which may be some of a mesh's. REQUIRES: the sink is concurrent.
/// Throws what the sink throws, and Error{cancelled}.
void emit_parts(const PartStore& parts, const VertexNumbers& weld, MeshSink& sink,
                Progress& progress);

/// Into `mesh`, begin() and end() included. Each part's space is given back as soon as it was
/// handed over: nothing but the records of `parts` is left. Throws Error{io, cancelled}.
void move_mesh(PartStore& parts, const VertexNumbers& weld, MeshLayout layout, ScratchMesh& mesh,
               Progress& progress);

}  // namespace isonest::detail
