// Creates a VTKHDF PolyData file whose arrays are filled in place.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace isonest::detail {

// Base64 arrays whose rows are written in any order, each at a known place.
//
// Three bytes are encoded as four letters. If a row ends within such a group, the next row has the
// other bytes, and may be written earlier or later: the bytes that are present wait until the
// others come.

/// Bytes that are encoded as one base64 text.
struct Base64Array {
    std::uint64_t text = 0;   ///< offset of the text in the file
    std::uint64_t bytes = 0;  ///< number of encoded bytes; 0: the array is not in base64

    [[nodiscard]] std::uint64_t letters() const { return (bytes + 2) / 3 * 4; }
};

/// Writes such arrays. It keeps three bytes for each boundary at which only one of the two
/// neighbours has come. Thread-safe.
class Base64Rows {
  public:
    /// Heap of one such boundary, and of put() while it writes.
    static constexpr std::uint64_t kWaiting = 80;
    static constexpr std::uint64_t kLetters = std::uint64_t{1} << 18U;
    /// Writes letters into the file.
    using Write = std::function<void(std::uint64_t place, std::span<const std::byte> letters)>;

    /// Writes `bytes` at position `at` of the array. Each byte of an array must be written exactly
    /// once. Throws what `write` throws.
    void put(const Base64Array& array, std::uint64_t at, std::span<const std::byte> bytes,
             const Write& write);
    /// Removes and returns what waits, for include() by an object for the same file in another
    /// process.
    std::string take();
    void include(std::string_view taken, const Write& write);
    /// Whether everything was written.
    [[nodiscard]] bool is_complete() const;

  private:
    /// Three bytes, or fewer at the end of an array.
    struct Group {
        std::array<std::uint8_t, 3> bytes{};
        std::uint8_t has = 0;  ///< a bit for each byte that has come
        std::uint8_t all = 0;  ///< a bit for each byte that exists
    };
    void add(std::uint64_t place, const Group& some, const Write& write);

    mutable std::mutex mutex_;
    std::map<std::uint64_t, Group> waiting_;  ///< by the offset of its letters
};

struct PolyDataShape {
    struct Attribute {
        std::string name;
        int components = 1;
        bool wide = false;          ///< float64 instead of float32
        bool of_triangles = false;  ///< there is also an array per triangle
    };
    std::uint64_t points = 0;
    std::uint64_t triangles = 0;
    std::vector<Attribute> attributes;  ///< per point
    bool labels_of_triangles = false;   ///< there is an array "BoundaryLabels"
    std::string unit = {};              ///< of length; empty: unknown
    std::string space = {};             ///< "RAS" or "LPS", of the points; empty: unknown
};

/// Offsets of the arrays' bytes in the file, row by row.
struct PolyDataOffsets {
    std::uint64_t points = 0;               ///< float32 x 3
    std::vector<std::uint64_t> attributes;  ///< float32 or float64 x components
    /// The same per triangle; 0 unless the attribute is also of triangles.
    std::vector<std::uint64_t> attributes_of_triangles;
    std::uint64_t labels_of_triangles = 0;  ///< int64 x 2; 0 if there is no such array
    std::uint64_t connectivity = 0;         ///< int64 x 3 for each triangle
    std::uint64_t ends = 0;                 ///< int64: three times the triangles so far
};

/// Creates the file with all arrays allocated, little endian and contiguous. Offsets begin with a 0
/// in front of `ends`, which must also be written. The format: Kitware, "VTKHDF File Format",
/// version 2.0. Throws Error{io}.
PolyDataOffsets create_polydata(const std::filesystem::path& path, const PolyDataShape& shape);

/// One of several meshes in a file.
struct PolyDataBlock {
    PolyDataShape shape;
    std::string name;        ///< letters, digits, "_" and "-"; unique
    std::string title = {};  ///< attribute "Name"; empty: none
    std::optional<std::array<std::uint8_t, 3>> color = {};  ///< attribute "Color", 0 to 1
};

/// Creates a file with a mesh for each block, as a vtkPartitionedDataSetCollection whose assembly
/// has them in this order. The format: version 2.1. Throws Error{io}.
std::vector<PolyDataOffsets> create_polydata_collection(const std::filesystem::path& path,
                                                        std::span<const PolyDataBlock> blocks);

/// Positions of the arrays in such a file.
struct PolyDataArrays {
    struct Array {
        std::uint64_t offset = 0;  ///< of the first number in the file
        std::uint64_t count = 0;   ///< of numbers
        bool wide = false;         ///< 64 bits
        bool integers = false;
    };
    Array points;
    Array connectivity;          ///< three corners per triangle
    Array ends;                  ///< as in PolyDataOffsets
    std::optional<Array> value;  ///< the attribute "value" of the points
};

/// Throws Error{corrupt, not_found}, and Error{unsupported} for another kind of VTKHDF, or arrays
/// that are not contiguous and little endian.
PolyDataArrays find_polydata(const std::filesystem::path& path);

}  // namespace isonest::detail
