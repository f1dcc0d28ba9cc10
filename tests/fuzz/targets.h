// Parsers of untrusted bytes as functions of bytes: for the fuzzer, and for the ordinary tests,
// which replay the corpus.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace isonest::detail::fuzz {

using Bytes = std::span<const std::uint8_t>;

/// Each returns when the bytes have been handled: read, or refused with an Error. Everything else
/// (another exception, a crash, a hang, much memory) is a finding.
void open_store(Bytes bytes);    ///< a file as a store: open, check, extract
void store_header(Bytes bytes);  ///< overwrites attributes of a complete store, through HDF5
void footer(Bytes bytes);  ///< the catalogue and footer of a complete store, with valid checksums
void chunk_table(Bytes bytes);  ///< the chunk table of a complete store, with a valid checksum
/// The label names of a complete store, with a valid checksum: the length of the names minus 1, and
/// the rows.
void label_table(Bytes bytes);
void label_file(Bytes bytes);    ///< a label table next to a volume
void chunk_decode(Bytes bytes);  ///< a stored chunk
void nrrd(Bytes bytes);          ///< an NRRD file
void raw(Bytes bytes);           ///< a raw file, possibly compressed by gzip
void volume(Bytes bytes);        ///< a file of any of the other single-file formats
/// A file of one format, whose seeds the target has. If the last byte is 128 or more, an array and
/// a component are chosen.
void one_file(const char* name, Bytes bytes);
/// A folder of up to four files; two bytes before each are its length.
void dicom(Bytes bytes);
/// The objects at the URL of a Zarr hierarchy: for each object a byte that says which one it is,
/// two bytes for its length, and its content.
void remote_zarr(Bytes bytes);
void answer(Bytes bytes);  ///< eight bytes of a request, and the head of a server's answer
/// Two bytes for the length of a URL, the URL, and a name relative to it.
void object_url(Bytes bytes);
/// A file of the cache on disk, with a valid checksum.
void cached_block(Bytes bytes);
/// A Zarr folder: its kind (an array of version 2, of version 3, a group), two bytes for the length
/// of its metadata, the metadata, and its only chunk.
void zarr(Bytes bytes);
void ply(Bytes bytes);  ///< a mesh for `picture`

struct Target {
    std::string name;
    void (*run)(Bytes);
};
const std::vector<Target>& targets();

}  // namespace isonest::detail::fuzz
