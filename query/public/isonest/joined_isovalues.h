// The surfaces of several isovalues as one mesh.
#pragma once

#include <functional>
#include <span>

#include <isonest/extract.h>

namespace isonest {

/// Like extract_isovalues(), but all meshes are joined into one, one after another in the order of
/// the isovalues, without common vertices. Vertices have the attribute "isovalue" (float64 if
/// float32 would round one of them and the sink supports it); .vtp and .vtkhdf files also have it
/// per element. The part of each isovalue has the same vertices and elements, in the same order, as
/// its mesh alone.
///
/// The meshes are kept in temporary files (ExtractOptions::scratch) until all are finished: `done`
/// is called for each of them before the sink gets any call other than prepare(). Throws as
/// extract_isovalues().
void extract_joined(const Store& store, std::span<const double> isovalues,
                    const SurfaceQuery& query, MeshSink& sink,
                    const std::function<void(std::size_t number, const ExtractReport&)>& done,
                    const ExtractOptions& options = {}, Progress& progress = silent_progress());

}  // namespace isonest
