#include "query/check/check_footer.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <isonest/error.h>

#include "store/container/by_hdf5/hdf5_view.h"
#include "store/container/codec.h"
#include "store/container/footer/footer.h"

namespace isonest::detail {
namespace {

/// The first version whose stores have a footer.
constexpr FormatVersion kFirst{2, 9};

std::string fault_of(const StoreReader& store) {
    const StoreBytes& file = store.bytes();
    const FoundCatalogue* const found = store.catalogue();
    if (found == nullptr) {
        return hdf5_end_of(file) == file.size()
                   ? ""  // an HDF5 program has changed the store
                   : "what stands behind HDF5's end of the file is no footer of this file";
    }
    if (hdf5_end_of(file) != found->footer.hdf5_end) {
        return "HDF5's part of the file ends elsewhere than the footer says";
    }
    const CatalogueTable& place = *found->catalogue.table;
    const HeldBytes table = file.read(place.offset, place.rows * sizeof(ChunkRow));
    const auto expected = Hdf5View(file).catalogue(store.layout(), table.bytes());
    if (!expected) {
        return "HDF5 does not find what the catalogue says";
    }
    if (checksum_of(table.bytes()) != place.xxh64) {
        return "the chunk table is not the one that was written";
    }
    if (store.version() > FormatVersion{}) {
        return "";  // there may be more in it
    }
    const std::uint64_t begin = found->footer.hdf5_end;
    const HeldBytes ours = file.read(begin, file.size() - begin);
    const std::vector<std::byte> bytes = bytes_behind_hdf5(begin, *expected);
    return std::equal(bytes.begin(), bytes.end(), ours.bytes().begin(), ours.bytes().end())
               ? ""
               : "the catalogue does not say what HDF5 finds in the file";
}

}  // namespace

void check_footer(const StoreReader& store, Findings& findings) {
    if (store.version() < kFirst) {
        return;
    }
    std::string fault;
    try {
        fault = fault_of(store);
        if (fault.empty()) {
            store.compare_range();
        }
    } catch (const Error& error) {
        if (error.kind() != ErrorKind::corrupt) {
            throw;
        }
        fault = error.what();
    }
    if (!fault.empty()) {
        findings.add("footer", store.layout().array(0, Field::values), {0, 0, 0}, kWholeChunk,
                     fault);
    }
}

}  // namespace isonest::detail
