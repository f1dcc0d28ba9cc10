// How other programs open a store.
#pragma once

#include <string>

namespace isonest::detail::cli {

/// A line that says under which names ParaView opens a store, and where the filter is that HDF5
/// needs for it. Sources: ParaView's readers_iohdf.xml (5.12 and later: vtkhdf, hdf), and the
/// documentation of VTKHDFReader of 5.11 (hdf).
std::string paraview_hint(const std::string& store);

}  // namespace isonest::detail::cli
