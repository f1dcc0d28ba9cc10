// A complete mesh in temporary files: input of the stages that change a mesh after its vertices
// have been welded.
#pragma once

#include <algorithm>
#include <array>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <span>

#include <isonest/mesh_sink.h>
#include <isonest/progress.h>

#include "store/files/scratch_file.h"

namespace isonest::detail {

// The corners of a mesh's elements in a temporary file.

/// Vertex numbers. For a line, the third repeats the second.
using ElementCorners = std::array<std::uint64_t, 3>;

/// A view of corners of elements, in 32 or 64 bits each.
class CornerView {
  public:
    using Narrow = std::array<std::uint32_t, 3>;

    class Iterator {
      public:
        using iterator_category = std::input_iterator_tag;
        using value_type = ElementCorners;
        using difference_type = std::ptrdiff_t;
        using pointer = void;
        using reference = ElementCorners;

        Iterator() = default;
        Iterator(const Narrow* narrow, const ElementCorners* wide) : narrow_(narrow), wide_(wide) {}
        ElementCorners operator*() const { return at(narrow_, wide_, 0); }
        Iterator& operator++() {
            narrow_ = moved(narrow_, 1);
            wide_ = moved(wide_, 1);
            return *this;
        }
        Iterator operator++(int) {
            const Iterator before = *this;
            ++*this;
            return before;
        }
        bool operator==(const Iterator&) const = default;

      private:
        const Narrow* narrow_ = nullptr;
        const ElementCorners* wide_ = nullptr;
    };

    CornerView() = default;
    explicit CornerView(std::span<const Narrow> corners)
        : narrow_(corners.data()), size_(corners.size()) {}
    template <class Range>  // NOLINTNEXTLINE(google-explicit-constructor): as a span is made
    requires std::convertible_to<const Range&, std::span<const ElementCorners>> CornerView(
        const Range& corners) {
        const std::span<const ElementCorners> wide = corners;
        wide_ = wide.data();
        size_ = wide.size();
    }

    [[nodiscard]] std::size_t size() const { return size_; }
    [[nodiscard]] bool empty() const { return size_ == 0; }
    ElementCorners operator[](std::size_t i) const { return at(narrow_, wide_, i); }
    [[nodiscard]] CornerView subspan(std::size_t first, std::size_t count) const {
        CornerView some;
        some.narrow_ = moved(narrow_, first);
        some.wide_ = moved(wide_, first);
        some.size_ = count;
        return some;
    }
    [[nodiscard]] Iterator begin() const { return {narrow_, wide_}; }
    [[nodiscard]] Iterator end() const { return {moved(narrow_, size_), moved(wide_, size_)}; }

  private:
    static ElementCorners at(const Narrow* narrow, const ElementCorners* wide, std::size_t i) {
        return narrow != nullptr ? ElementCorners{narrow[i][0], narrow[i][1], narrow[i][2]}
                                 : wide[i];
    }
    template <class T>
    static const T* moved(const T* array, std::size_t by) {
        return array != nullptr ? array + by : nullptr;
    }
    const Narrow* narrow_ = nullptr;
    const ElementCorners* wide_ = nullptr;
    std::size_t size_ = 0;
};

/// Corners are stored in 32 bits if there are few enough vertices. Thread-safety: write() of ranges
/// that do not overlap, and reading, from any thread; the rest from one.
class CornerFile {
  public:
    enum class Bits { as_needed, all };
    static constexpr std::uint64_t kNoVertex = std::numeric_limits<std::uint64_t>::max();

    explicit CornerFile(const ScratchFolder& folder, Bits bits = Bits::as_needed)
        : file_(folder), bits_(bits) {}

    /// For corners below `vertices`.
    void begin(std::uint64_t vertices);
    /// Throws Error{io}.
    void write(std::uint64_t first, std::span<const ElementCorners> corners);
    /// Call after all were written, or before any is set. Throws Error{io}.
    void map(std::uint64_t elements);

    /// REQUIRES for everything below: map() was called.
    [[nodiscard]] CornerView all() const {
        return is_narrow_ ? CornerView(narrow().first(elements_))
                          : CornerView(std::span<const ElementCorners>(wide().first(elements_)));
    }
    [[nodiscard]] std::uint64_t size() const { return elements_; }
    /// May return kNoVertex.
    [[nodiscard]] std::uint64_t at(std::uint64_t element, std::size_t corner) const {
        if (!is_narrow_) {
            return wide()[element][corner];
        }
        const std::uint32_t v = narrow()[element][corner];
        return v == kNoNarrow ? kNoVertex : v;
    }
    [[nodiscard]] ElementCorners operator[](std::uint64_t element) const {
        return {at(element, 0), at(element, 1), at(element, 2)};
    }
    void set(std::uint64_t element, std::size_t corner, std::uint64_t vertex) {
        if (is_narrow_) {
            narrow()[element][corner] = static_cast<std::uint32_t>(vertex);
        } else {
            wide()[element][corner] = vertex;
        }
    }
    void set(std::uint64_t element, const ElementCorners& corners) {
        for (std::size_t i = 0; i < corners.size(); ++i) {
            set(element, i, corners[i]);
        }
    }
    /// Keeps only the first elements.
    void shrink(std::uint64_t elements) { elements_ = elements; }
    /// Removes all elements and frees the space. Throws Error{io}.
    void clear() {
        elements_ = 0;
        file_.clear();
    }
    /// Declares that these elements will not be read any more; call once per element.
    void release(std::uint64_t first, std::uint64_t count) {
        file_.release(first * row_bytes(), count * row_bytes());
    }
    /// REQUIRES: Bits::all.
    [[nodiscard]] std::span<const ElementCorners> in_64_bits() const {
        return wide().first(elements_);
    }

  private:
    static constexpr std::uint32_t kNoNarrow = std::numeric_limits<std::uint32_t>::max();
    [[nodiscard]] std::span<CornerView::Narrow> narrow() const {
        return file_.as<CornerView::Narrow>();
    }
    [[nodiscard]] std::span<ElementCorners> wide() const { return file_.as<ElementCorners>(); }
    [[nodiscard]] std::uint64_t row_bytes() const {
        return is_narrow_ ? sizeof(CornerView::Narrow) : sizeof(ElementCorners);
    }
    PiecedFile file_;
    Bits bits_;
    bool is_narrow_ = false;
    std::uint64_t elements_ = 0;
};

inline void CornerFile::begin(std::uint64_t vertices) {
    is_narrow_ = bits_ == Bits::as_needed && vertices < kNoNarrow;
}

inline void CornerFile::write(std::uint64_t first, std::span<const ElementCorners> corners) {
    if (!is_narrow_) {
        file_.write_at(first * sizeof(ElementCorners), std::as_bytes(corners));
        return;
    }
    std::array<CornerView::Narrow, 1024> some;
    while (!corners.empty()) {
        const std::size_t count = std::min(some.size(), corners.size());
        std::transform(corners.begin(), corners.begin() + static_cast<std::ptrdiff_t>(count),
                       some.begin(), [](const ElementCorners& c) {
                           return CornerView::Narrow{static_cast<std::uint32_t>(c[0]),
                                                     static_cast<std::uint32_t>(c[1]),
                                                     static_cast<std::uint32_t>(c[2])};
                       });
        file_.write_at(first * sizeof(CornerView::Narrow),
                       std::as_bytes(std::span(some).first(count)));
        first += count;
        corners = corners.subspan(count);
    }
}

inline void CornerFile::map(std::uint64_t elements) {
    elements_ = elements;
    file_.map(elements * row_bytes());
}

/// A file with the elements that `each` visits. `elements`: their number; their corners are below
/// `vertices`. Throws Error{io}.
template <class Each>
CornerFile corner_file(const ScratchFolder& folder, std::uint64_t vertices, std::uint64_t elements,
                       const Each& each) {
    CornerFile file(folder);
    file.begin(vertices);
    file.map(elements);
    std::uint64_t at = 0;
    each([&](const ElementCorners& corners) { file.set(at++, corners); });
    return file;
}

/// A sink that stores the mesh in temporary files, which grow as it comes and are mapped by end();
/// then it can be read. Thread-safety: that of a concurrent sink; after end(), that of constant
/// data.
class ScratchMesh : public MeshSink {
  public:
    explicit ScratchMesh(const ScratchFolder& folder,
                         CornerFile::Bits bits = CornerFile::Bits::as_needed);

    void begin(const MeshLayout& layout) override;
    void add_vertices(const VertexBatch& batch) override;
    void add_elements(const ElementBatch& batch) override;
    void end() override;
    [[nodiscard]] bool concurrent() const override { return true; }

    [[nodiscard]] const MeshLayout& layout() const { return layout_; }
    [[nodiscard]] std::span<const std::array<float, 3>> positions() const {
        return {position_file_.as<std::array<float, 3>>().data(),
                static_cast<std::size_t>(layout_.vertices)};
    }
    /// The attributes of vertex `v`.
    [[nodiscard]] std::span<const std::byte> row(std::uint64_t v) const {
        return row_file_.as<const std::byte>().subspan(v * layout_.row_bytes, layout_.row_bytes);
    }
    /// The attributes of all vertices.
    [[nodiscard]] std::span<const std::byte> rows() const {
        return row_file_.as<const std::byte>().first(layout_.vertices * layout_.row_bytes);
    }
    [[nodiscard]] CornerView corners() const { return corners_.all(); }
    /// REQUIRES: the mesh was made with Bits::all.
    [[nodiscard]] std::span<const ElementCorners> corners_in_64_bits() const {
        return corners_.in_64_bits();
    }

    /// As a corner: the element is to be removed.
    static constexpr std::uint64_t kNoVertex = CornerFile::kNoVertex;
    /// For changing the mesh; the box of its layout is not updated.
    [[nodiscard]] std::span<std::array<float, 3>> changeable_positions() {
        return {position_file_.as<std::array<float, 3>>().data(),
                static_cast<std::size_t>(layout_.vertices)};
    }
    [[nodiscard]] std::span<std::byte> changeable_rows() {
        return row_file_.as<std::byte>().first(layout_.vertices * layout_.row_bytes);
    }
    [[nodiscard]] CornerFile& changeable_corners() { return corners_; }
    /// An additional vertex: a copy of a vertex of the mesh, at another place.
    struct MovedCopy {
        std::array<float, 3> at{};
        std::uint64_t of = 0;
    };
    /// Adds vertices with the next numbers; no element uses them yet. The box of the layout is not
    /// updated. Invalidates spans of vertices. Throws Error{io}.
    void add_copies(std::span<const MovedCopy> copies);
    /// Removes elements whose first corner is kNoVertex, and vertices that no other element uses.
    /// The order is preserved. Invalidates views. Throws Error{io, cancelled}.
    void compact(const ScratchFolder& folder, Progress& progress);

  private:
    ScratchFile position_file_;
    ScratchFile row_file_;
    CornerFile corners_;
    MeshLayout layout_;
};

/// Size of the output of emit_elements(), and the number of triangles without area in float32.
struct EmittedMesh {
    std::uint64_t vertices = 0;
    std::uint64_t elements = 0;
    std::uint64_t zero_area_triangles = 0;
};

/// Outputs `elements`, whose corners are vertices of `mesh`, to a sink: begin(), all batches as
/// often as the sink requests them, end(). Only used vertices are output, numbered in the order of
/// their first use. Data that grows with the mesh is kept in temporary files in `folder`. Throws
/// Error{io, cancelled} and what the sink throws.
EmittedMesh emit_elements(const ScratchMesh& mesh, const CornerView& elements,
                          const ScratchFolder& folder, MeshSink& sink, Progress& progress);

/// Outputs only the vertices, or only the elements, of a mesh to a sink, with their numbers. Throws
/// Error{cancelled} and what the sink throws.
void emit_vertices(const ScratchMesh& mesh, MeshSink& sink, Progress& progress);
void emit_elements(const ScratchMesh& mesh, MeshSink& sink, Progress& progress);

}  // namespace isonest::detail
