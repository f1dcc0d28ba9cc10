#include <fmt/format.h>
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <mutex>
#include <utility>

#include <isonest/error.h>
#include <isonest/vertex_fields.h>

#include "query/values/flat_pieces.h"
#include "query/values/interpolation.h"
#include "query/values/label_view.h"
#include "query/values/linear_bound.h"
#include "query/values/node_fields.h"
#include "query/values/node_sampler.h"
#include "store/base/memory.h"
#include "store/base/workers.h"
#include "store/container/chunk_cache.h"
#include "store/container/codec.h"
#include "store/container/reader.h"

namespace isonest {
namespace detail {
namespace {

/// Number of vertices or elements in a task.
constexpr std::size_t kAtOnce = 2048;

/// One scalar quantity of a store.
class Quantity {
  public:
    /// `memory`: for `threads` threads and the cache. REQUIRES: it is enough for the threads.
    Quantity(const Store& store, std::uint64_t memory, int threads)
        : store_(store.reader()),
          interpolation_(store_.layout(), {0, Cells::hexahedra}),
          tolerance_(store.rounding().tolerance),
          cache_(store_, memory - static_cast<std::uint64_t>(threads) * heap_beside_cache(store)) {}

    /// Bytes that a thread needs, with a chunk in the cache.
    static std::uint64_t heap_of_thread(const Store& store) {
        return heap_beside_cache(store) + chunk_bytes(store);
    }

    [[nodiscard]] const Interpolation& interpolation() const { return interpolation_; }
    [[nodiscard]] double tolerance() const { return tolerance_; }
    [[nodiscard]] std::filesystem::path path() const { return store_.path(); }
    [[nodiscard]] NodeSampler sampler() { return NodeSampler(cache_); }
    /// The place of a vertex; nothing outside the volume.
    [[nodiscard]] auto place_of(const std::array<float, 3>& vertex) const;

    /// Fetches the chunks around these points ahead, if the store is remote.
    void prefetch(std::span<const std::array<float, 3>> points);

  private:
    static std::uint64_t chunk_bytes(const Store& store) {
        return store.reader().layout().array(0, Field::values).chunk_bytes();
    }
    /// A thread decodes one chunk, and holds two others that are no longer in the cache.
    static std::uint64_t heap_beside_cache(const Store& store) {
        return decode_heap(chunk_bytes(store)) + 2 * chunk_bytes(store);
    }

    const StoreReader& store_;
    Interpolation interpolation_;
    double tolerance_;
    ChunkCache cache_;
};

Double3 in_double(const std::array<float, 3>& p) {
    return {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])};
}

auto Quantity::place_of(const std::array<float, 3>& vertex) const {
    const Double3 point = in_double(vertex);
    return interpolation_.place_of(point, interpolation_.slack_of_float(point));
}

void Quantity::prefetch(std::span<const std::array<float, 3>> points) {
    if (!store_.is_remote()) {
        return;
    }
    const ArrayInfo& array = store_.layout().array(0, Field::values);
    ChunkNeeds needs;
    std::vector<WantedChunk> wanted;
    for (const std::array<float, 3>& point : points) {
        const auto place = place_of(point);
        if (!place) {
            continue;
        }
        wanted.clear();
        want_box(array, place->cell, place->cell + Int3{1, 1, 1}, wanted);
        for (const WantedChunk& chunk : wanted) {
            needs.add(*chunk.array, chunk.chunk);
        }
    }
    if (needs.bytes() <= cache_.budget()) {
        cache_.prefetch(needs.chunks());
    }
}

}  // namespace
}  // namespace detail

struct VertexFields::Parts {
    struct Entry {
        VertexFieldReport report;
        std::vector<std::unique_ptr<detail::Quantity>> quantities;
        bool is_double = false;  ///< whether the values are float64
    };

    explicit Parts(int threads) : arena(threads) {}

    /// Calls work(begin, end) for parts of [0, count) in parallel. Threads that wait do no work of
    /// other arenas, which might need a lock that the caller holds.
    template <class Work>
    void for_parts(std::size_t count, const Work& work) {
        arena.execute([&] {
            tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, detail::kAtOnce),
                              [&](const tbb::blocked_range<std::size_t>& part) {
                                  work(part.begin(), part.end());
                              });
        });
    }

    tbb::task_arena arena;  ///< of the threads for which there is memory
    std::vector<Entry> fields;
    mutable std::mutex mutex;  ///< protects the reports
};

namespace detail {
namespace {

using Entry = VertexFields::Parts::Entry;

class FieldSink : public MeshSink {
  public:
    FieldSink(VertexFields::Parts& parts, MeshSink& inner) : parts_(parts), inner_(inner) {}
    FieldSink(VertexFields::Parts& parts, std::unique_ptr<MeshSink> inner)
        : parts_(parts), owned_(std::move(inner)), inner_(*owned_) {}

    void prepare(const MeshLayout& layout, std::span<const std::filesystem::path> inputs) override {
        std::vector<std::filesystem::path> all(inputs.begin(), inputs.end());
        for (const Entry& field : parts_.fields) {
            for (const auto& quantity : field.quantities) {
                all.push_back(quantity->path());
            }
        }
        inner_.prepare(with_fields(layout), all);
    }
    void begin(const MeshLayout& layout) override {
        first_pass_ = true;
        layout_ = with_fields(layout);
        inner_.begin(layout_);
    }
    void add_vertices(const VertexBatch& batch) override {
        const std::vector<std::byte> rows = rows_of(batch, first_pass_);
        inner_.add_vertices({batch.first, batch.positions, rows, layout_.row_bytes});
    }
    void add_elements(const ElementBatch& batch) override {
        const std::vector<std::byte> rows = rows_of(batch.nearby, false);
        ElementBatch with = batch;
        with.nearby = {batch.nearby.first, batch.nearby.positions, rows, layout_.row_bytes};
        if (first_pass_) {
            measure(with);
        }
        inner_.add_elements(with);
    }
    [[nodiscard]] bool again() override {
        first_pass_ = false;
        return inner_.again();
    }
    void end() override { inner_.end(); }
    [[nodiscard]] bool holds_float64() const override { return inner_.holds_float64(); }

  private:
    [[nodiscard]] MeshLayout with_fields(MeshLayout layout) const;
    [[nodiscard]] std::vector<std::byte> rows_of(const VertexBatch& batch, bool counts);
    void fill(const Entry& field, const VertexAttribute& attribute, const VertexBatch& batch,
              std::vector<std::byte>& rows, std::vector<char>& is_missing) const;
    void measure(const ElementBatch& batch);

    VertexFields::Parts& parts_;
    std::unique_ptr<MeshSink> owned_;
    MeshSink& inner_;
    MeshLayout layout_;
    bool first_pass_ = true;
};

MeshLayout FieldSink::with_fields(MeshLayout layout) const {
    for (const Entry& field : parts_.fields) {
        VertexAttribute attribute;
        attribute.name = field.report.name;
        attribute.components = field.report.components;
        attribute.is_double = field.is_double && inner_.holds_float64();
        attribute.offset = layout.row_bytes;
        layout.row_bytes += attribute.bytes();
        layout.attributes.push_back(std::move(attribute));
    }
    return layout;
}

/// The rows of the batch with the fields at their end. `counts`: whether vertices without a value
/// are added to the reports.
std::vector<std::byte> FieldSink::rows_of(const VertexBatch& batch, bool counts) {
    const std::size_t count = batch.positions.size();
    std::vector<std::byte> rows(count * layout_.row_bytes);
    parts_.for_parts(batch.row_bytes > 0 ? count : 0, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
            std::memcpy(&rows[i * layout_.row_bytes], &batch.attributes[i * batch.row_bytes],
                        batch.row_bytes);
        }
    });
    const std::size_t first = layout_.attributes.size() - parts_.fields.size();
    std::vector<char> is_missing(count);
    for (std::size_t f = 0; f < parts_.fields.size(); ++f) {
        Entry& field = parts_.fields[f];
        std::fill(is_missing.begin(), is_missing.end(), '\0');
        fill(field, layout_.attributes[first + f], batch, rows, is_missing);
        if (counts) {
            const std::lock_guard lock(parts_.mutex);
            field.report.missing_vertices +=
                static_cast<std::uint64_t>(std::count(is_missing.begin(), is_missing.end(), '\1'));
        }
    }
    return rows;
}

void FieldSink::fill(const Entry& field, const VertexAttribute& attribute, const VertexBatch& batch,
                     std::vector<std::byte>& rows, std::vector<char>& is_missing) const {
    for (std::size_t c = 0; c < field.quantities.size(); ++c) {
        Quantity& quantity = *field.quantities[c];
        quantity.prefetch(batch.positions);
        const Interpolation& interpolation = quantity.interpolation();
        parts_.for_parts(batch.positions.size(), [&](std::size_t begin, std::size_t end) {
            NodeSampler nodes = quantity.sampler();
            for (std::size_t i = begin; i < end; ++i) {
                const auto place = quantity.place_of(batch.positions[i]);
                const double value = place ? interpolation.value(nodes, *place)
                                           : std::numeric_limits<double>::quiet_NaN();
                if (std::isnan(value)) {
                    is_missing[i] = '\1';
                }
                std::byte* const at = &rows[i * layout_.row_bytes + attribute.offset];
                if (attribute.is_double) {
                    std::memcpy(at + c * sizeof(double), &value, sizeof(value));
                } else {
                    if (std::fabs(value) > static_cast<double>(std::numeric_limits<float>::max())) {
                        throw Error(ErrorKind::limit, {quantity.path().string()},
                                    fmt::format("the values for {} are beyond the range of the "
                                                "mesh's 32-bit floats",
                                                field.report.name),
                                    {{RemedyKind::other_format, ".ply, .vtp, .vtkhdf"}});
                    }
                    const auto rounded = static_cast<float>(value);
                    std::memcpy(at + c * sizeof(float), &rounded, sizeof(rounded));
                }
            }
        });
    }
}

/// Updates the bounds in the reports. `batch`: has the fields already.
void FieldSink::measure(const ElementBatch& batch) {
    const std::size_t first = layout_.attributes.size() - parts_.fields.size();
    for (std::size_t f = 0; f < parts_.fields.size(); ++f) {
        Entry& field = parts_.fields[f];
        const VertexAttribute& attribute = layout_.attributes[first + f];
        parts_.for_parts(batch.nearby_corners.size(), [&](std::size_t begin, std::size_t end) {
            double worst = 0;
            std::vector<char> is_unknown(end - begin);
            for (std::size_t c = 0; c < field.quantities.size(); ++c) {
                Quantity& quantity = *field.quantities[c];
                NodeSampler nodes = quantity.sampler();
                const Interpolation& in = quantity.interpolation();
                LinearBound bound;
                for (std::size_t i = begin; i < end; ++i) {
                    std::array<Double3, 3> corners{};
                    std::array<double, 3> values{};
                    for (std::size_t k = 0; k < 3; ++k) {
                        const std::uint32_t at = batch.nearby_corners[i][k];
                        corners[k] = in.relative(in_double(batch.nearby.positions[at]));
                        values[k] = batch.nearby.number(at, attribute, static_cast<int>(c));
                    }
                    const bool is_known = std::none_of(values.begin(), values.end(),
                                                       [](double v) { return std::isnan(v); });
                    double here = 0;
                    const auto add = [&](const auto& piece, const auto& at_corners) {
                        const double of_piece =
                            bound.of(piece, at_corners, [&](const Double3& steps) {
                                return in.value(nodes, in.place_in(steps));
                            });
                        here = std::max(here, of_piece);
                        return !std::isnan(of_piece);
                    };
                    if (!is_known || !for_each_flat_piece(in.steps(), corners, values, add)) {
                        is_unknown[i - begin] = '\1';
                    } else {
                        worst = std::max(worst, here + quantity.tolerance());
                    }
                }
            }
            const auto unknown =
                static_cast<std::uint64_t>(std::count(is_unknown.begin(), is_unknown.end(), '\1'));
            const std::lock_guard lock(parts_.mutex);
            field.report.linear_bound = std::max(field.report.linear_bound, worst);
            field.report.unbounded_elements += unknown;
            field.report.bounded_elements += is_unknown.size() - unknown;
        });
    }
}

std::string in_upper_case(std::string text) {
    std::transform(text.begin(), text.end(), text.begin(),
                   [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
    return text;
}

void require_name(const std::string& name) {
    constexpr std::size_t kMaxLength = 64;
    const auto is_letter = [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_';
    };
    const bool valid = !name.empty() && name.size() <= kMaxLength && is_letter(name.front()) &&
                       std::all_of(name.begin(), name.end(),
                                   [&](char c) { return is_letter(c) || (c >= '0' && c <= '9'); });
    if (!valid) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("'{}' cannot be the name of vertex values: it must have 1 to {} "
                                "letters, digits and underscores, and not start with a digit",
                                name, kMaxLength));
    }
    if (VertexFields::is_reserved(name)) {
        throw Error(ErrorKind::invalid_argument,
                    fmt::format("'{}' cannot be the name of vertex values: meshes use it for "
                                "something else",
                                name));
    }
}

}  // namespace
}  // namespace detail

bool VertexFields::is_reserved(const std::string& name) {
    static constexpr std::array kReserved{"NORMAL", "VALUE", "ERROR", "ISOVALUE", "X",
                                          "Y",      "Z",     "NX",    "NY",       "NZ",
                                          "RED",    "GREEN", "BLUE",  "ALPHA",    "FEATURE_ID_0"};
    const std::string upper = detail::in_upper_case(name);
    return std::any_of(kReserved.begin(), kReserved.end(),
                       [&](const char* reserved) { return upper == reserved; });
}

std::optional<std::string> VertexFields::name_used_twice(
    std::span<const VertexAttribute> attributes) {
    std::vector<std::string> names;
    for (const VertexAttribute& attribute : attributes) {
        const std::string name = detail::in_upper_case(attribute.name);
        names.push_back(name);
        if (attribute.components > 1 && attribute.name != "normal") {
            names.insert(names.end(), {name + "_X", name + "_Y", name + "_Z"});
        }
    }
    std::sort(names.begin(), names.end());
    const auto twice = std::adjacent_find(names.begin(), names.end());
    return twice != names.end() ? std::optional(*twice) : std::nullopt;
}

VertexFields::VertexFields(std::vector<VertexField> fields, const ReadOptions& options) {
    std::vector<VertexAttribute> attributes;
    std::vector<const Store*> stores;
    for (const VertexField& field : fields) {
        detail::require_name(field.name);
        attributes.push_back({field.name, static_cast<int>(field.components.size())});
        if (field.components.size() != 1 && field.components.size() != 3) {
            throw Error(ErrorKind::invalid_argument,
                        fmt::format("{}: vertex values have 1 or 3 components, not {}", field.name,
                                    field.components.size()));
        }
        stores.insert(stores.end(), field.components.begin(), field.components.end());
    }
    if (const auto twice = name_used_twice(attributes)) {
        throw Error(
            ErrorKind::invalid_argument,
            fmt::format("two vertex values, or components of them, have the name {} (upper and "
                        "lower case are the same in some formats)",
                        *twice));
    }
    int threads = detail::Workers::count_of(options.threads);
    for (const Store* const store : stores) {
        detail::require_numbers(store->reader(), "a value at a vertex");
        const std::uint64_t each = detail::Quantity::heap_of_thread(*store);
        detail::require_memory(store->path().string(), options.memory, stores.size() * each,
                               "the values at the vertices");
        threads = static_cast<int>(std::min<std::uint64_t>(options.memory / (stores.size() * each),
                                                           static_cast<std::uint64_t>(threads)));
    }
    parts_ = std::make_unique<Parts>(threads);
    for (VertexField& field : fields) {
        Parts::Entry entry;
        entry.report.name = std::move(field.name);
        entry.report.components = static_cast<int>(field.components.size());
        for (const Store* const store : field.components) {
            entry.quantities.push_back(std::make_unique<detail::Quantity>(
                *store, options.memory / stores.size(), threads));
            entry.is_double = entry.is_double || store->type() == ValueType::f64;
        }
        parts_->fields.push_back(std::move(entry));
    }
}

VertexFields::~VertexFields() = default;

std::unique_ptr<MeshSink> VertexFields::sink(MeshSink& inner) {
    return std::make_unique<detail::FieldSink>(*parts_, inner);
}

std::unique_ptr<MeshSink> VertexFields::sink(std::unique_ptr<MeshSink> inner) {
    return std::make_unique<detail::FieldSink>(*parts_, std::move(inner));
}

std::vector<VertexFieldReport> VertexFields::reports() const {
    const std::lock_guard lock(parts_->mutex);
    std::vector<VertexFieldReport> reports;
    for (const Parts::Entry& field : parts_->fields) {
        reports.push_back(field.report);
    }
    return reports;
}

}  // namespace isonest
