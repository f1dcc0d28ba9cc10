// The surfaces of several isovalues as one mesh.
#pragma once

#include <functional>
#include <span>

#include <isonest/extract.h>

namespace isonest {

/// As extract_isovalues(), with all meshes in one: one after the other, in the order of the
/// isovalues, without a vertex in common. The vertices have the attribute "isovalue" (float64 where
/// float32 would round one of them and the sink holds it), which .vtp and .vtkhdf files have for
/// each element as well; within its part of the mesh, each isovalue has the vertices and elements
/// that it has alone, in the same order. The meshes are kept in temporary files
/// (ExtractOptions::scratch) until all are made: `done` is called for each of them before the sink
/// gets anything but prepare(). Throws as extract_isovalues().
void extract_joined(const Store& store, std::span<const double> isovalues,
                    const SurfaceQuery& query, MeshSink& sink,
                    const std::function<void(std::size_t number, const ExtractReport&)>& done,
                    const ExtractOptions& options = {}, Progress& progress = silent_progress());

}  // namespace isonest
