// The destination of the layers of one level of a block: the chunks of its fields, and the centres
// passed to the coarser levels.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include <isonest/field.h>
#include <isonest/int3.h>

#include "preprocess/indicators/layer.h"
#include "preprocess/indicators/row_kernels.h"
#include "preprocess/indicators/value_rows.h"
#include "store/base/box.h"
#include "store/container/chunk_source.h"
#include "store/container/codec.h"
#include "store/container/format.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {

// The chunks of one indicator field that a block of the level pass fills and encodes.

/// One chunk in its stored form, on its way to the writer.
struct EncodedChunk {
    const ArrayInfo* array = nullptr;
    Int3 chunk;
    std::vector<std::byte> bytes;
    ChunkRow row;

    /// Encodes the chunk's elements, without the shuffle where that pays.
    void encode(std::span<const std::byte> raw) {
        if (encode_shorter(raw, array->codec, bytes)) {
            row.flags |= kChunkUnshuffled;
        }
    }
};

/// Up to 2 x 2 x 2 neighbouring chunks of an indicator array, filled layer by layer.
class IndicatorChunks {
  public:
    /// `first` chunk and number of chunks per axis (those outside the array's grid are left out).
    IndicatorChunks(const ArrayInfo& array, const Int3& first, const Int3& count, bool exact);
    /// For lattice nodes instead of chunks: `count` per axis starting at `lo`, as far as they
    /// exist.
    static IndicatorChunks of_nodes(const ArrayInfo& array, const Int3& lo, const Int3& count,
                                    bool exact);

    /// Copies the part of layer k that lies in these chunks.
    template <class Real>
    void put(const LayerRange& range, std::int64_t k, const Layer<Real>& layer);
    /// Encodes all chunks and appends them.
    void encode(std::vector<EncodedChunk>& out) const;
    [[nodiscard]] const ArrayInfo& array() const { return array_; }
    /// Calls f(lattice node, bytes) for each row along x, as stored.
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
    /// Rounds one row up and writes it to the elements starting at `at`; `line` is a buffer for the
    /// row.
    template <class Stored, class Real>
    void put_row(const Real* from, Part& part, std::int64_t at, std::vector<Stored>& line) const;

    const ArrayInfo& array_;
    bool exact_;
    std::vector<Part> parts_;
    std::vector<IndicatorCode> codes_;
    std::vector<float> floats_;
};

// The range of finite values, row by row.

/// Smallest and largest finite value so far, in lanes that compilers keep in vector registers.
template <class T>
class ValueRange {
  public:
    ValueRange() {
        low_.fill(std::numeric_limits<T>::max());
        high_.fill(std::numeric_limits<T>::lowest());
    }
    void include(const T* row, std::int64_t n) {
        std::int64_t i = 0;
        if constexpr (std::is_floating_point_v<T>) {
            if (!all_finite(row, n)) {
                missing_ = true;
                for (; i < n; ++i) {
                    if (std::isfinite(row[i])) {
                        lane(0, row[i]);
                    }
                }
            }
        }
        // Copies, because a row of bytes may alias the members.
        std::array<T, kLanes> low = low_;
        std::array<T, kLanes> high = high_;
        for (; i + static_cast<std::int64_t>(kLanes) <= n; i += kLanes) {
            for (std::size_t l = 0; l < kLanes; ++l) {
                const T v = row[i + static_cast<std::int64_t>(l)];
                low[l] = v < low[l] ? v : low[l];
                high[l] = v > high[l] ? v : high[l];
            }
        }
        low_ = low;
        high_ = high;
        for (; i < n; ++i) {
            lane(0, row[i]);
        }
    }
    /// min() is +inf and max() is -inf if there were no finite values.
    [[nodiscard]] double min() const {
        return any() ? static_cast<double>(*std::min_element(low_.begin(), low_.end()))
                     : std::numeric_limits<double>::infinity();
    }
    [[nodiscard]] double max() const {
        return any() ? static_cast<double>(*std::max_element(high_.begin(), high_.end()))
                     : -std::numeric_limits<double>::infinity();
    }
    [[nodiscard]] bool missing() const { return missing_; }

  private:
    static constexpr std::size_t kLanes = 16;
    void lane(std::size_t l, T v) {
        low_[l] = v < low_[l] ? v : low_[l];
        high_[l] = v > high_[l] ? v : high_[l];
    }
    [[nodiscard]] bool any() const {
        return *std::min_element(low_.begin(), low_.end()) <=
               *std::max_element(high_.begin(), high_.end());
    }

    std::array<T, kLanes> low_;
    std::array<T, kLanes> high_;
    bool missing_ = false;
};

// Chunks of values: a level consists of every second node of the finer one (injection).

/// Encodes one chunk of values by injection: node i of the array is node step * i of the box.
template <class T>
EncodedChunk encode_values(const ArrayInfo& array, const Int3& chunk, const Box<T>& box,
                           std::int64_t step) {
    const Int3 lo = array.first_node(chunk);
    const Int3 n = min(array.chunk, array.nodes - lo);
    const auto size = static_cast<std::size_t>(array.chunk.product());
    const auto raw = std::make_unique_for_overwrite<T[]>(size);
    if (n != array.chunk) {
        std::fill_n(raw.get(), size, T{0});  // beyond the array's edge
    }
    EncodedChunk out;
    out.array = &array;
    out.chunk = chunk;
    ValueRange<T> range;
    for (std::int64_t z = 0; z < n.z; ++z) {
        for (std::int64_t y = 0; y < n.y; ++y) {
            const T* const from =
                box.row((lo.y + y) * step, (lo.z + z) * step) + (lo.x * step - box.lo.x);
            T* const to = raw.get() + array.chunk.linear({0, y, z});
            take_row(from, step, to, n.x);
            range.include(to, n.x);
        }
    }
    out.row.min = range.min();
    out.row.max = range.max();
    out.row.flags = range.missing() ? kChunkHasMissing : 0;
    out.encode(std::as_bytes(std::span(raw.get(), size)));
    return out;
}

template <class T>
void encode_all_values(const ArrayInfo* array, const Int3& first, const Int3& count,
                       const Box<T>& box, std::int64_t step, std::vector<EncodedChunk>& out) {
    if (array == nullptr) {
        return;
    }
    const Int3 end = min(first + count, array->grid);
    for (std::int64_t z = first.z; z < end.z; ++z) {
        for (std::int64_t y = first.y; y < end.y; ++y) {
            for (std::int64_t x = first.x; x < end.x; ++x) {
                out.push_back(encode_values(*array, {x, y, z}, box, step));
            }
        }
    }
}

/// The indicator chunks of one level that a block fills.
class LevelSink {
  public:
    /// `first` chunk and number of chunks per axis, for every field that is stored at the level.
    LevelSink(const StoreLayout& layout, int level, const Int3& first, const Int3& count);
    template <class Real>
    void put(Field field, const LayerRange& range, std::int64_t k, const Layer<Real>& layer) {
        for (auto& [source, chunks] : parts_) {
            if (source == field) {
                chunks.put(range, k, layer);
            }
        }
    }
    void encode(std::vector<EncodedChunk>& out) const;
    /// For lattice nodes instead of chunks: `count` per axis starting at `lo`, as far as they
    /// exist.
    static LevelSink of_nodes(const StoreLayout& layout, int level, const Int3& lo,
                              const Int3& count);
    /// Calls f(array, lattice node, bytes) for each row along x, as stored.
    template <class F>
    void each_row(const F& f) const {
        for (const auto& part : parts_) {
            const IndicatorChunks& chunks = part.second;
            chunks.each_row([&](const Int3& at, std::span<const std::byte> bytes) {
                f(chunks.array(), at, bytes);
            });
        }
    }

  private:
    LevelSink() = default;
    std::vector<std::pair<Field, IndicatorChunks>> parts_;
};

/// Copies the centres of layer k (in slot `centre`) that lie in `to`.
template <class Real>
void keep_centres(int centre, const LayerRange& range, std::int64_t k, const Layer<Real>& layer,
                  Box<float>& to) {
    const Int3 o = slot_offset(centre);
    const auto count = [&](int axis) { return range.count(axis, static_cast<int>(o[axis])); };
    if (k < to.lo.z || k >= to.lo.z + to.size.z || k - range.lo.z >= count(2)) {
        return;
    }
    const Int3 lo = max(range.lo, to.lo);
    const Int3 end = min(range.lo + Int3{count(0), count(1), 0}, to.lo + to.size);
    for (std::int64_t y = lo.y; y < end.y; ++y) {
        const Real* const from = layer.row(centre, y - range.lo.y);
        round_up_row(from + (lo.x - range.lo.x), to.row(y, k) + (lo.x - to.lo.x),
                     std::max<std::int64_t>(end.x - lo.x, 0));
    }
}

}  // namespace isonest::detail
