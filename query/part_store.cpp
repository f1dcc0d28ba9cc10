#include "query/part_store.h"

#include <algorithm>

namespace isonest {
namespace {

using Point = std::array<float, 3>;

bool has_no_area(const Point& a, const Point& b, const Point& c) {
    if (a == b || b == c || c == a) {
        return true;
    }
    const auto d = [](const Point& p, const Point& q, std::size_t i) {
        return static_cast<double>(q[i]) - static_cast<double>(p[i]);
    };
    return d(a, b, 1) * d(a, c, 2) == d(a, b, 2) * d(a, c, 1) &&
           d(a, b, 2) * d(a, c, 0) == d(a, b, 0) * d(a, c, 2) &&
           d(a, b, 0) * d(a, c, 1) == d(a, b, 1) * d(a, c, 0);
}

template <class T>
std::uint64_t bytes_of(const std::vector<T>& v) {
    return v.size() * sizeof(T);
}

std::uint64_t aligned(std::uint64_t bytes) {
    return (bytes + 7) / 8 * 8;
}

}  // namespace

PartStore::PartStore(const std::filesystem::path& folder, const Double3& spacing,
                     const Double3& origin)
    : file_(folder), record_file_(folder), spacing_(spacing), origin_(origin) {}

void PartStore::append(std::uint64_t order, const MeshPart& part) {
    std::vector<Point> world(part.positions.size());
    for (std::size_t i = 0; i < world.size(); ++i) {
        for (std::size_t axis = 0; axis < 3; ++axis) {
            world[i][axis] =
                static_cast<float>(origin_[axis] + spacing_[axis] * part.positions[i][axis]);
        }
    }
    std::uint64_t zero = 0;
    for (const auto& t : part.triangles) {
        zero += has_no_area(world[t[0]], world[t[1]], world[t[2]]) ? 1 : 0;
    }
    zero_area_ += zero;
    PartRecord record;
    record.order = order;
    record.vertices = static_cast<std::uint32_t>(world.size());
    record.triangles = static_cast<std::uint32_t>(part.triangles.size());
    record.shared = static_cast<std::uint32_t>(part.shared.size());
    record.names = static_cast<std::uint32_t>(part.names.size());
    record.cuts = static_cast<std::uint32_t>(part.cuts.size());
    const std::uint64_t size = bytes_of(part.names) + aligned(bytes_of(part.cuts)) +
                               aligned(bytes_of(part.shared)) + aligned(bytes_of(world)) +
                               aligned(bytes_of(part.triangles));
    std::uint64_t index = 0;
    {
        const std::lock_guard lock(mutex_);
        record.offset = end_;
        end_ += size;
        index = count_++;
    }
    std::uint64_t at = record.offset;
    const auto write = [&](const auto& v) {
        file_.write_at(at, std::as_bytes(std::span(v)));
        at += aligned(bytes_of(v));
    };
    write(part.names);
    write(part.cuts);
    write(part.shared);
    write(world);
    write(part.triangles);
    record_file_.write_at(index * sizeof(PartRecord), std::as_bytes(std::span(&record, 1)));
}

void PartStore::seal() {
    data_ = file_.map(end_);
    record_file_.map(count_ * sizeof(PartRecord));
    records_ = record_file_.as<PartRecord>();
    std::sort(records_.begin(), records_.end(),
              [](const PartRecord& a, const PartRecord& b) { return a.order < b.order; });
}

std::span<const MeshPart::Name> PartStore::names(const PartRecord& r) const {
    return slice<MeshPart::Name>(r.offset, r.names);
}
std::span<const MeshPart::Cut> PartStore::cuts(const PartRecord& r) const {
    return slice<MeshPart::Cut>(r.offset + r.names * sizeof(MeshPart::Name), r.cuts);
}
std::span<const MeshPart::Shared> PartStore::shared(const PartRecord& r) const {
    return slice<MeshPart::Shared>(
        r.offset + r.names * sizeof(MeshPart::Name) + aligned(r.cuts * sizeof(MeshPart::Cut)),
        r.shared);
}
std::span<const std::array<float, 3>> PartStore::vertices(const PartRecord& r) const {
    return slice<Point>(r.offset + r.names * sizeof(MeshPart::Name) +
                            aligned(r.cuts * sizeof(MeshPart::Cut)) +
                            aligned(r.shared * sizeof(MeshPart::Shared)),
                        r.vertices);
}
std::span<const std::array<std::uint32_t, 3>> PartStore::triangles(const PartRecord& r) const {
    return slice<std::array<std::uint32_t, 3>>(
        r.offset + r.names * sizeof(MeshPart::Name) + aligned(r.cuts * sizeof(MeshPart::Cut)) +
            aligned(r.shared * sizeof(MeshPart::Shared)) + aligned(r.vertices * sizeof(Point)),
        r.triangles);
}

}  // namespace isonest
