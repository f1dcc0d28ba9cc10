// What takes bytes from strangers, as functions of bytes: for the fuzzer, and for the ordinary
// tests, which replay the corpus.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace isonest::detail::fuzz {

using Bytes = std::span<const std::uint8_t>;

/// Each returns when the bytes have been dealt with: taken, or refused with an Error. Everything
/// else (another exception, a crash, a hang, much memory) is a finding.
void open_store(Bytes bytes);    ///< a file as a store: open, check, extract
void store_header(Bytes bytes);  ///< the attributes of a whole store are overwritten, through HDF5
void footer(Bytes bytes);       ///< the catalogue and footer of a whole store, with right checksums
void chunk_table(Bytes bytes);  ///< the chunk table of a whole store, with a right checksum
/// The names of labels of a whole store, with a right checksum: the bytes of a name, less 1, and
/// rows.
void label_table(Bytes bytes);
void label_file(Bytes bytes);    ///< a table of labels beside a volume
void chunk_decode(Bytes bytes);  ///< a stored chunk
void nrrd(Bytes bytes);          ///< an NRRD file
void raw(Bytes bytes);           ///< a raw file, perhaps gzipped
void volume(Bytes bytes);        ///< a file of any of the other formats of one file
/// A file of one format, whose seeds the target has; what is chosen of several arrays and
/// components if the last byte is 128 or more.
void one_file(const char* name, Bytes bytes);
/// A folder of up to four files; two bytes before each say how long it is.
void dicom(Bytes bytes);
/// What stands at a URL of a Zarr hierarchy: for each object a byte that says which, two bytes that
/// say how long it is, and what it has.
void far_zarr(Bytes bytes);
void answer(Bytes bytes);      ///< eight bytes of a question, and the head of a server's answer
void object_url(Bytes bytes);  ///< two bytes that say how long a URL is, that, and a name beside it
/// A file of the cache on disk, with a right checksum.
void cached_block(Bytes bytes);
/// A Zarr folder: of which kind (an array of version 2, of version 3, a group), two bytes that say
/// how long its description is, that, and its only chunk.
void zarr(Bytes bytes);
void ply(Bytes bytes);  ///< a mesh for `picture`

struct Target {
    std::string name;
    void (*run)(Bytes);
};
const std::vector<Target>& targets();

}  // namespace isonest::detail::fuzz
