#include "query/mesh/part_store.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "query/mesh/vertex_stars.h"
#include "store/base/memory.h"
#include "store/base/vectors.h"

namespace isonest::detail {
namespace {

using Point = std::array<float, 3>;

/// The start of each piece of a part, in bytes from the part's start: names, cuts, shared,
/// vertices, triangles, those that may share their place, end.
struct Pieces {
    std::uint64_t cuts;
    std::uint64_t shared;
    std::uint64_t vertices;
    std::uint64_t attributes;
    std::uint64_t triangles;
    std::uint64_t not_alone;
    std::uint64_t end;
    Pieces(const PartRecord& r, std::size_t width)
        : cuts(aligned(r.names * sizeof(MeshPart::Name))),
          shared(cuts + aligned(r.cuts * sizeof(MeshPart::Cut))),
          vertices(shared + aligned(r.shared * sizeof(MeshPart::Shared))),
          attributes(vertices + aligned(r.vertices * sizeof(Point))),
          triangles(attributes + aligned(r.vertices * width * sizeof(std::uint32_t))),
          not_alone(triangles + aligned(r.triangles * sizeof(std::array<std::uint32_t, 3>))),
          end(not_alone + aligned(r.not_alone * sizeof(std::uint32_t))) {}
};

bool is_near_node(const Double3& p, double sight) {
    constexpr double kToInteger = 0x1.8p52;  // adding and subtracting it rounds
    return std::all_of(p.begin(), p.end(), [sight](double x) {
        return std::fabs(x - ((x + kToInteger) - kToInteger)) <= sight;
    });
}

bool is_near_face(const Double3& p, const PlaceWatch& watch) {
    bool near = false;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        near = near || std::fabs(p[axis] - watch.box.lo[axis]) <= watch.sight ||
               std::fabs(p[axis] - watch.box.hi[axis]) <= watch.sight;
    }
    return near;
}

std::vector<std::uint32_t> not_alone_in(const MeshPart& part, const PlaceWatch& watch) {
    if (!part.world.empty()) {
        return part.off_edges;
    }
    std::vector<std::uint32_t> found;
    auto off_edge = part.off_edges.begin();
    for (std::uint32_t v = 0; v < part.positions.size(); ++v) {
        const bool is_off = off_edge != part.off_edges.end() && *off_edge == v;
        off_edge += is_off ? 1 : 0;
        if (is_off || is_near_node(part.positions[v], watch.sight) ||
            is_near_face(part.positions[v], watch)) {
            found.push_back(v);
        }
    }
    return found;
}

/// Number of vertices whose normal, the first of `width` attributes, is 0.
std::uint32_t count_without_normal(std::span<const std::uint32_t> attributes, std::size_t width) {
    std::uint32_t count = 0;
    for (std::size_t at = 0; at < attributes.size(); at += width) {
        Point normal{};
        std::memcpy(normal.data(), &attributes[at], sizeof(normal));
        count += has_no_direction(normal) ? 1 : 0;
    }
    return count;
}

/// Overhead of a part in memory.
constexpr std::uint64_t kKeptOverhead = 64;

}  // namespace

PartStore::PartStore(const ScratchFolder& folder, const LatticeSteps& steps, const Double3& origin,
                     std::uint64_t memory, std::size_t attributes)
    : file_(folder),
      record_file_(folder),
      steps_(steps),
      origin_(origin),
      memory_(memory),
      attributes_(attributes) {}

void PartStore::append(std::uint64_t order, const MeshPart& part) {
    PartRecord record;
    record.order = order;
    record.vertices = static_cast<std::uint32_t>(part.positions.size() + part.world.size());
    record.triangles = static_cast<std::uint32_t>(part.triangles.size());
    record.shared = static_cast<std::uint32_t>(part.shared.size());
    record.names = static_cast<std::uint32_t>(part.names.size());
    record.cuts = static_cast<std::uint32_t>(part.cuts.size());
    std::vector<std::uint32_t> not_alone;
    if (watch_) {
        not_alone = not_alone_in(part, *watch_);
    }
    record.not_alone = static_cast<std::uint32_t>(not_alone.size());
    const Pieces pieces(record, attributes_);
    auto bytes = std::make_unique_for_overwrite<std::byte[]>(pieces.end);
    const auto put = [&](std::uint64_t at, const auto& v) {
        if (!v.empty()) {
            std::memcpy(bytes.get() + at, v.data(), v.size() * sizeof(v[0]));
        }
    };
    put(0, part.names);
    put(pieces.cuts, part.cuts);
    put(pieces.shared, part.shared);
    put(pieces.attributes, part.attributes);
    put(pieces.triangles, part.triangles);
    put(pieces.not_alone, not_alone);
    auto* const world = reinterpret_cast<Point*>(bytes.get() + pieces.vertices);
    Point lo = MeshLayout::kEmptyLo;
    Point hi = MeshLayout::kEmptyHi;
    std::copy(part.world.begin(), part.world.end(), world);
    for (std::size_t i = 0; i < part.positions.size(); ++i) {
        const Double3 way = steps_.vector(part.positions[i]);
        for (std::size_t axis = 0; axis < 3; ++axis) {
            world[i][axis] = static_cast<float>(origin_[axis] + way[axis]);
        }
    }
    for (std::size_t i = 0; i < record.vertices; ++i) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const float x = world[i][axis];
            lo[axis] = std::min(lo[axis], x);
            hi[axis] = std::max(hi[axis], x);
        }
    }
    std::uint64_t zero = 0;
    for (const auto& t : part.triangles) {
        zero += has_no_area(world[t[0]], world[t[1]], world[t[2]]) ? 1 : 0;
    }
    if (counts_normals_) {
        record.without_normal = count_without_normal(part.attributes, attributes_);
    }
    include({zero, record.without_normal, part.cut_fans, lo, hi});
    const std::uint64_t number = reserve(record, pieces.end);
    if (record.in_memory == 0) {
        file_.write_at(record.offset, {bytes.get(), static_cast<std::size_t>(pieces.end)});
    } else {
        keep(record, std::move(bytes));
    }
    write_record(number, record);
}

std::uint64_t PartStore::reserve(PartRecord& record, std::uint64_t bytes) {
    const std::lock_guard lock(mutex_);
    bytes_ += bytes;
    if (bytes + kKeptOverhead <= memory_) {
        memory_ -= bytes + kKeptOverhead;
        record.in_memory = 1;
        record.offset = kept_.size();
        kept_.emplace_back();
    } else {
        record.in_memory = 0;
        record.offset = end_;
        end_ += bytes;
    }
    return count_++;
}

void PartStore::keep(const PartRecord& record, std::unique_ptr<std::byte[]> bytes) {
    const std::lock_guard lock(mutex_);
    kept_[record.offset] = std::move(bytes);
}

void PartStore::write_record(std::uint64_t number, const PartRecord& record) {
    record_file_.write_at(number * sizeof(PartRecord), std::as_bytes(std::span(&record, 1)));
}

PartRecord PartStore::add(const PartRecord& record) {
    PartRecord own = record;
    const std::uint64_t bytes = count_bytes(record);
    const std::uint64_t number = reserve(own, bytes);
    if (own.in_memory != 0) {
        keep(own, std::make_unique_for_overwrite<std::byte[]>(bytes));
    }
    write_record(number, own);
    return own;
}

void PartStore::put(const PartRecord& record, std::uint64_t at, std::span<const std::byte> bytes) {
    if (record.in_memory != 0) {
        std::copy(bytes.begin(), bytes.end(), kept_[record.offset].get() + at);
    } else {
        file_.write_at(record.offset + at, bytes);
    }
}

void PartStore::include(const PartTotals& other) {
    const std::lock_guard lock(mutex_);
    zero_area_ += other.zero_area;
    without_normal_ += other.without_normal;
    cut_fans_ += other.cut_fans;
    for (std::size_t axis = 0; axis < 3; ++axis) {
        // The sign of zero would depend on the order of threads.
        lo_[axis] = std::min(lo_[axis], other.lo[axis]) + 0.0F;
        hi_[axis] = std::max(hi_[axis], other.hi[axis]) + 0.0F;
    }
}

void PartStore::seal() {
    data_ = file_.map(end_);
    record_file_.map(count_ * sizeof(PartRecord));
    records_ = record_file_.as<PartRecord>();
    std::sort(records_.begin(), records_.end(),
              [](const PartRecord& a, const PartRecord& b) { return a.order < b.order; });
    std::uint64_t not_alone = 0;
    for (PartRecord& r : records_) {
        r.first_not_alone = not_alone;
        not_alone += r.not_alone;
    }
}

void PartStore::release(const PartRecord& r) {
    if (r.in_memory != 0) {
        kept_[r.offset].reset();
    } else {
        file_.release(r.offset, Pieces(r, attributes_).end);
    }
}

std::uint64_t PartStore::count_bytes(const PartRecord& r) const {
    return Pieces(r, attributes_).end;
}
std::span<const std::byte> PartStore::all_bytes(const PartRecord& r) const {
    const std::byte* const part =
        r.in_memory != 0 ? kept_[r.offset].get() : data_.data() + r.offset;
    return {part, static_cast<std::size_t>(count_bytes(r))};
}
std::span<const MeshPart::Name> PartStore::names(const PartRecord& r) const {
    return slice<MeshPart::Name>(r, 0, r.names);
}
std::span<const MeshPart::Cut> PartStore::cuts(const PartRecord& r) const {
    return slice<MeshPart::Cut>(r, Pieces(r, attributes_).cuts, r.cuts);
}
std::span<const MeshPart::Shared> PartStore::shared(const PartRecord& r) const {
    return slice<MeshPart::Shared>(r, Pieces(r, attributes_).shared, r.shared);
}
std::span<const std::array<float, 3>> PartStore::vertices(const PartRecord& r) const {
    return slice<Point>(r, Pieces(r, attributes_).vertices, r.vertices);
}
std::span<std::array<float, 3>> PartStore::changeable_vertices(const PartRecord& r) {
    std::byte* const part = r.in_memory != 0 ? kept_[r.offset].get() : data_.data() + r.offset;
    return {reinterpret_cast<Point*>(part + Pieces(r, attributes_).vertices), r.vertices};
}
std::span<std::uint32_t> PartStore::changeable_attributes(const PartRecord& r) {
    std::byte* const part = r.in_memory != 0 ? kept_[r.offset].get() : data_.data() + r.offset;
    return {reinterpret_cast<std::uint32_t*>(part + Pieces(r, attributes_).attributes),
            r.vertices * attributes_};
}
std::span<const std::uint32_t> PartStore::attributes(const PartRecord& r) const {
    return slice<std::uint32_t>(r, Pieces(r, attributes_).attributes,
                                r.vertices * static_cast<std::uint32_t>(attributes_));
}
std::span<const std::array<std::uint32_t, 3>> PartStore::triangles(const PartRecord& r) const {
    return slice<std::array<std::uint32_t, 3>>(r, Pieces(r, attributes_).triangles, r.triangles);
}
std::span<const std::uint32_t> PartStore::not_alone(const PartRecord& r) const {
    return slice<std::uint32_t>(r, Pieces(r, attributes_).not_alone, r.not_alone);
}

}  // namespace isonest::detail
