// The chunks of one indicator field that a block of the level pass fills and encodes.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "preprocess/indicators/layer.h"
#include "store/container/chunk_source.h"
#include "store/container/indicator_code.h"

namespace isonest::detail {

/// One chunk in its stored form, on the way to the writer.
struct EncodedChunk {
    const ArrayInfo* array = nullptr;
    Int3 chunk;
    std::vector<std::byte> bytes;
    ChunkRow row;
};

/// Up to 2 x 2 x 2 neighbouring chunks of an indicator array, filled layer by layer.
class IndicatorChunks {
  public:
    /// `first` chunk and how many per axis (those beyond the array's grid are left out).
    IndicatorChunks(const ArrayInfo& array, const Int3& first, const Int3& count, bool exact);
    /// Of lattice nodes, not of chunks: `count` per axis from `lo` on, as far as there are any.
    static IndicatorChunks of_nodes(const ArrayInfo& array, const Int3& lo, const Int3& count,
                                    bool exact);

    /// Takes the part of layer k that lies in these chunks.
    template <class Real>
    void put(const LayerRange& range, std::int64_t k, const Layer<Real>& layer);
    /// Encodes all chunks and appends them.
    void encode(std::vector<EncodedChunk>& out) const;
    [[nodiscard]] const ArrayInfo& array() const { return array_; }
    /// f(lattice node, bytes) for each row along x, as stored.
    template <class F>
    void each_row(const F& f) const {
        for (const Part& part : parts_) {
            const std::size_t bytes =
                static_cast<std::size_t>(part.n.x * array_.components) * array_.codec.element_size;
            for (std::int64_t z = 0; z < part.n.z; ++z) {
                for (std::int64_t y = 0; y < part.n.y; ++y) {
                    const auto at =
                        static_cast<std::size_t>(part.size.linear({0, y, z}) * array_.components) *
                        array_.codec.element_size;
                    f(part.lo + Int3{0, y, z},
                      std::span<const std::byte>(part.raw.get() + at, bytes));
                }
            }
        }
    }

  private:
    IndicatorChunks(const ArrayInfo& array, bool exact) : array_(array), exact_(exact) {}
    struct Part {
        Int3 chunk;
        Int3 lo;    ///< first lattice node
        Int3 n;     ///< nodes inside the array
        Int3 size;  ///< nodes in `raw`
        std::unique_ptr<std::byte[]> raw;
        float min = std::numeric_limits<float>::infinity();
        float max = 0;
    };
    /// Rounds one row up and spreads it over the elements from `at` on; `line` is room for the row.
    template <class Stored, class Real>
    void put_row(const Real* from, Part& part, std::int64_t at, std::vector<Stored>& line) const;

    const ArrayInfo& array_;
    bool exact_;
    std::vector<Part> parts_;
    std::vector<IndicatorCode> codes_;
    std::vector<float> floats_;
};

}  // namespace isonest::detail
