#include "store/container/parts/make_catalogue.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <list>
#include <string>

#include <isonest/error.h>

#include "store/container/parts/cube_range_table.h"
#include "store/container/parts/footer.h"
#include "store/container/parts/hdf5_types.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {
namespace {

/// In the order of FORMAT.md.
constexpr std::array<const char*, 31> kAttributes{"format",         "version",
                                                  "flags",          "nodes",
                                                  "spacing",        "origin",
                                                  "value_type",     "chunk",
                                                  "compression",    "exact",
                                                  "fields",         "range",
                                                  "has_missing",    "xxh64",
                                                  "direction",      "direction_xxh64",
                                                  "offsets_x",      "offsets_y",
                                                  "offsets_z",      "offsets_xxh64",
                                                  "position_type",  "position_numbers",
                                                  "position_folds", "position_xxh64",
                                                  "unit",           "unit_xxh64",
                                                  "frame",          "frame_xxh64",
                                                  "tolerance",      "tolerance_xxh64",
                                                  "complete"};

std::optional<AttributeKind> kind_of(hid_t type) {
    const std::size_t size = H5Tget_size(type);
    switch (H5Tget_class(type)) {
        case H5T_INTEGER:
            return size == sizeof(std::uint32_t)   ? std::optional(AttributeKind::u32)
                   : size == sizeof(std::uint64_t) ? std::optional(AttributeKind::u64)
                                                   : std::nullopt;
        case H5T_FLOAT:
            return size == sizeof(double) ? std::optional(AttributeKind::f64) : std::nullopt;
        case H5T_STRING:
            return H5Tis_variable_str(type) == 0 ? std::optional(AttributeKind::text)
                                                 : std::nullopt;
        default:
            return std::nullopt;
    }
}

/// Builds the parts, and owns the bytes that they refer to.
class Maker {
  public:
    Maker(hid_t file, const StoreLayout& layout, std::span<const std::byte> table)
        : file_(file), layout_(layout), table_(table) {}

    std::optional<std::vector<std::byte>> make() {
        if (!add_attributes() || !add_table() || !add_ranges() || !add_names()) {
            return std::nullopt;
        }
        add_totals();
        return catalogue_bytes(out_);
    }

  private:
    std::span<std::byte> hold(std::size_t size) { return held_.emplace_back(size); }

    bool add_attributes() {
        for (const char* const name : kAttributes) {
            if (H5Aexists(file_, name) <= 0) {
                continue;
            }
            const AttributeHandle attribute(H5Aopen(file_, name, H5P_DEFAULT));
            const TypeHandle type(H5Aget_type(attribute.get()));
            const std::optional<AttributeKind> kind = kind_of(type.get());
            constexpr hsize_t kLongest = 65536;
            const hsize_t size = H5Aget_storage_size(attribute.get());
            if (!kind || size > kLongest) {
                return false;
            }
            const std::span<std::byte> bytes = hold(size);
            if (H5Aread(attribute.get(), type.get(), bytes.data()) < 0) {
                return false;
            }
            out_.attributes.push_back({name, *kind, bytes});
        }
        return true;
    }

    bool add_table() {
        const DatasetHandle table(H5Dopen2(file_, "chunks", H5P_DEFAULT));
        const auto sum = table.valid() ? read_integers(table.get(), "xxh64", 1) : std::nullopt;
        if (!sum || H5Dget_offset(table.get()) == HADDR_UNDEF) {
            return false;
        }
        const std::size_t page = kRowsOfPage * sizeof(ChunkRow);
        const std::size_t pages = (table_.size() + page - 1) / page;
        const std::span<std::byte> sums = hold(pages * sizeof(std::uint64_t));
        for (std::size_t i = 0; i < pages; ++i) {
            const std::uint64_t of_page =
                checksum_of(table_.subspan(i * page, std::min(page, table_.size() - i * page)));
            std::memcpy(sums.data() + i * sizeof(of_page), &of_page, sizeof(of_page));
        }
        out_.table = {H5Dget_offset(table.get()), table_.size() / sizeof(ChunkRow), kRowsOfPage,
                      (*sum)[0], sums};
        return true;
    }

    bool add_ranges() {
        for (int level = kFirstRangeLevel; layout_.has_cube_ranges(level); ++level) {
            const auto open = [&](const std::string& path) {
                return DatasetHandle(H5Dopen2(file_, path.c_str(), H5P_DEFAULT));
            };
            const DatasetHandle ranges = open(StoreLayout::cube_ranges_path(level));
            const DatasetHandle sums = open(StoreLayout::cube_range_sums_path(level));
            const auto planes = static_cast<std::uint64_t>(layout_.lattice().cells_at(level).z);
            const std::uint64_t bytes = planes * sizeof(std::uint64_t);
            if (!ranges.valid() || !sums.valid() || H5Dget_offset(ranges.get()) == HADDR_UNDEF ||
                H5Dget_storage_size(sums.get()) != bytes) {
                return false;
            }
            const std::span<std::byte> held = hold(bytes);
            if (H5Dread(sums.get(), H5T_STD_U64LE, H5S_ALL, H5S_ALL, H5P_DEFAULT, held.data()) <
                0) {
                return false;
            }
            out_.ranges.push_back(
                {level, H5Dget_offset(ranges.get()), H5Dget_storage_size(ranges.get()), held});
        }
        return true;
    }

    bool add_names() {
        if (!layout_.header().label_names) {
            return true;
        }
        const DatasetHandle table(H5Dopen2(file_, LabelTable::kPath, H5P_DEFAULT));
        const auto sum = table.valid() ? read_integers(table.get(), "xxh64", 1) : std::nullopt;
        if (!sum || H5Dget_offset(table.get()) == HADDR_UNDEF) {
            return false;
        }
        const SpaceHandle space(H5Dget_space(table.get()));
        const TypeHandle type(H5Dget_type(table.get()));
        out_.names = {H5Dget_offset(table.get()),
                      static_cast<std::uint64_t>(H5Sget_simple_extent_npoints(space.get())),
                      H5Tget_size(type.get()), (*sum)[0]};
        return true;
    }

    void add_totals() {
        for (const ArrayInfo& array : layout_.all_arrays()) {
            if (array.alias) {
                continue;
            }
            ArrayTotals totals{.first_row = array.first_row,
                               .chunks = static_cast<std::uint64_t>(array.grid.product())};
            for (std::uint64_t i = 0; i < totals.chunks; ++i) {
                ChunkRow row;
                std::memcpy(&row, table_.data() + (array.first_row + i) * sizeof(row), sizeof(row));
                totals.add(row);
            }
            out_.totals.push_back(totals);
        }
    }

    hid_t file_;
    const StoreLayout& layout_;
    std::span<const std::byte> table_;
    std::list<std::vector<std::byte>> held_;
    Catalogue out_;
};

}  // namespace

std::optional<std::vector<std::byte>> make_catalogue(std::int64_t file, const StoreLayout& layout,
                                                     std::span<const std::byte> table) {
    if (table.size() < layout.rows() * sizeof(ChunkRow)) {
        return std::nullopt;
    }
    const QuietHdf5 quiet;
    return Maker(file, layout, table).make();
}

void append_footer(const std::filesystem::path& file, const std::vector<std::byte>& catalogue,
                   const std::filesystem::path& shown) {
    const int fd = ::open(file.c_str(), O_WRONLY | O_CLOEXEC | O_NOFOLLOW);
    const off_t end = fd < 0 ? -1 : ::lseek(fd, 0, SEEK_END);
    bool good = end >= 0;
    if (good) {
        const std::vector<std::byte> bytes =
            bytes_behind_hdf5(static_cast<std::uint64_t>(end), catalogue);
        for (std::size_t done = 0; good && done < bytes.size();) {
            const ssize_t n = ::write(fd, bytes.data() + done, bytes.size() - done);
            good = n > 0 || (n < 0 && errno == EINTR);
            errno = n == 0 ? ENOSPC : errno;
            done += n > 0 ? static_cast<std::size_t>(n) : 0;
        }
    }
    const int error = errno;
    if (fd >= 0) {
        good = ::close(fd) == 0 && good;
    }
    if (!good) {
        throw Error(ErrorKind::io, {shown.string()},
                    fmt::format("cannot write the footer: {}", std::strerror(error)));
    }
}

}  // namespace isonest::detail
