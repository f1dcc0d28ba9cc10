// Rows of numbers out of bytes: what all sources of raw numbers share.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include <isonest/volume_source.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/numbers/raw_layout.h"

namespace isonest::detail {

/// Reverses the bytes of each number of `size` bytes.
void swap_bytes(std::byte* data, std::uint64_t bytes, std::size_t size);
/// Of the volume, and of the array that it is, or is a part of.
std::uint64_t volume_bytes(const RawLayout& layout);
std::uint64_t data_bytes(const RawLayout& layout);
/// "3 x 4 x 5 nodes of uint8", for messages.
std::string text_of_nodes(const RawLayout& layout);
/// Throws Error{unsupported} unless each axis has a number of nodes that can be.
void check_nodes(const std::string& name, const RawLayout& layout);
/// Whether rows follow each other, and planes, none inside of another one.
bool is_nested(const RawLayout& layout);
/// What tells a layout from others, as lines of VolumeSource::identity().
std::string identity_of_layout(const RawLayout& layout);

/// Rows [y0, y0 + ny) of planes [z0, z0 + nz): what VolumeSource::read() reads.
struct Slab {
    std::int64_t z0 = 0;
    std::int64_t nz = 0;
    std::int64_t y0 = 0;
    std::int64_t ny = 0;
};

/// The file, what describes it, and further files.
std::vector<InputFile> inputs_of(const InputFile& file, const RawLayout& layout);

/// identity_of_inputs() of a file and what describes it, and what tells the layout; empty where the
/// inputs cannot be told from others.
std::string identity_of_raw(const InputFile& file, const RawLayout& layout);

/// Rows by reads of bytes at any place.
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
    /// What read() is going to read.
    virtual void before_rows(const Slab& /*slab*/) {}
    virtual void read_bytes(std::uint64_t at, std::byte* dst, std::uint64_t bytes) = 0;
    /// The last node was read.
    virtual void after_last() {}
    /// The byte of node (0, 0, 0).
    [[nodiscard]] std::uint64_t start() const {
        return layout_.offset + layout_.first * size_of(layout_.type);
    }
    InputFile file_;
    std::string name_;
    RawLayout layout_;

  private:
    /// Of each row what lies between its nodes is read too.
    void read_rows(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
                   std::byte* dst);
};

}  // namespace isonest::detail
