// Rows of numbers made from bytes: the code that all sources of raw numbers share.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/volume_source.h>

#include "preprocess/sources/bytes/input_file.h"

namespace isonest::detail {

// Where numbers lie in a file, and how they are stored.

/// Whether the numbers are compressed: detected from their first bytes (if nothing describes the
/// file), or as a header says, which must then agree with the first bytes.
enum class Packing { recognised, plain, gzip, zlib, deflate };

/// Where and how the numbers are stored: after `start` bytes and `lines` lines of the file as
/// stored, and then `offset` bytes of what is decompressed from there.
struct RawLayout {
    Int3 nodes{1, 1, 1};
    ValueType type = ValueType::u8;
    bool big_endian = false;
    Packing packing = Packing::recognised;
    std::uint64_t start = 0;
    std::uint64_t lines = 0;
    std::uint64_t offset = 0;
    bool offset_from_end = false;  ///< the data are the last bytes of the file (not with gzip)
    bool exact_length = true;      ///< bytes after the data are an error
    /// For a volume in a larger array (components of a vector, time steps, another axis order):
    /// values from one node to the next along x, y and z, each > 0. None: x fastest, without gaps.
    std::optional<Int3> strides = {};
    /// strides and `first` are in bytes instead of values; only for local, uncompressed files.
    bool strides_in_bytes = false;
    std::uint64_t first = 0;  ///< values of that array before node (0, 0, 0)
    std::uint64_t whole = 0;  ///< values in that array; 0: as many as nodes
    Double3 spacing{1, 1, 1};
    Double3 origin{0, 0, 0};
    Directions direction = kAlongWorld;
    std::optional<LengthUnit> unit = {};  ///< of spacing and origin
    AnatomicalFrame frame = AnatomicalFrame::unknown;
    InputFile header;  ///< the file that describes the numbers, if it is another one
    std::vector<InputFile> others = {};  ///< further files with numbers
};

/// Reverses the bytes of each number of `size` bytes.
void swap_bytes(std::byte* data, std::uint64_t bytes, std::size_t size);
/// Bytes of the volume, and of the array that it is, or is a part of.
std::uint64_t volume_bytes(const RawLayout& layout);
std::uint64_t data_bytes(const RawLayout& layout);
/// "3 x 4 x 5 nodes of uint8", for messages.
std::string text_of_nodes(const RawLayout& layout);
/// Throws Error{unsupported} unless each axis has a valid number of nodes.
void check_nodes(const std::string& name, const RawLayout& layout);
/// Whether rows, and planes, follow each other without being interleaved.
bool is_nested(const RawLayout& layout);
/// Identifies a layout, as lines of VolumeSource::identity().
std::string identity_of_layout(const RawLayout& layout);

/// Rows [y0, y0 + ny) of planes [z0, z0 + nz): the arguments of VolumeSource::read().
struct Slab {
    std::int64_t z0 = 0;
    std::int64_t nz = 0;
    std::int64_t y0 = 0;
    std::int64_t ny = 0;
};

/// The file, the one that describes it, and further files.
std::vector<InputFile> inputs_of(const InputFile& file, const RawLayout& layout);

/// identity_of_inputs() of a file and the one that describes it, with the identity of the layout;
/// empty if the inputs cannot be identified.
std::string identity_of_raw(const InputFile& file, const RawLayout& layout);

/// Reads rows by reading bytes at any position.
class RawBase : public VolumeSource {
  public:
    RawBase(InputFile file, std::string name, RawLayout layout)
        : file_(std::move(file)), name_(std::move(name)), layout_(std::move(layout)) {}
    [[nodiscard]] VolumeDescription describe() const override {
        return {layout_.nodes,     layout_.type, layout_.spacing, layout_.origin, name_,
                layout_.direction, false,        layout_.unit,    layout_.frame};
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override {
        return local_files(inputs_of(file_, layout_));
    }
    [[nodiscard]] std::string identity() const override;

    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) final;

  protected:
    /// Called before read() reads this slab.
    virtual void before_rows(const Slab& /*slab*/) {}
    virtual void read_bytes(std::uint64_t at, std::byte* dst, std::uint64_t bytes) = 0;
    /// Called after the last node was read.
    virtual void after_last() {}
    /// The byte offset of node (0, 0, 0).
    [[nodiscard]] std::uint64_t start() const {
        return layout_.offset + layout_.first * size_of(layout_.type);
    }
    InputFile file_;
    std::string name_;
    RawLayout layout_;

  private:
    /// Also reads the bytes between the nodes of each row.
    void read_rows(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
                   std::byte* dst);
};

}  // namespace isonest::detail
