// Whether all ranks have been given the same store.
#pragma once

#include <string>

#include "store/container/reader.h"
#include "store/ranks/communicator.h"

namespace isonest::detail::cli {

/// Refuses at rank 0 if `name` is another store to some ranks than to rank 0, or if it is a store
/// to some ranks alone. `store`: null where it is none. Collective. Throws
/// Error{invalid_argument}.
void require_same_store(Communicator& ranks, const StoreReader* store, const std::string& name);

}  // namespace isonest::detail::cli
