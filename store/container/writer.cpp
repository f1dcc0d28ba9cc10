#include "store/container/writer.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <isonest/error.h>
#include <isonest/field.h>
#include <isonest/value_type.h>

#include "store/container/parts/hdf5_types.h"
#include "store/container/parts/header_writer.h"
#include "store/container/parts/make_catalogue.h"
#include "store/files/output_file.h"
#include "store/files/scratch_file.h"
#include "store/hdf5/file_drivers.h"
#include "store/hdf5/handles.h"
#include "store/hdf5/zstd_filter.h"

namespace isonest::detail {

struct StoreWriter::Impl {
    std::filesystem::path path;
    UnfinishedFile unfinished;
    StoreLayout layout;
    PlannedWrites planned;
    bool is_planned;
    std::unique_ptr<std::byte[]> nothing;  ///< passed in place of a planned chunk's bytes; never
                                           ///< accessed
    std::uint32_t nothing_bytes = 0;
    FileHandle file;
    std::vector<DatasetHandle> datasets;  // one per array; invalid for aliases
    ScratchFile rows_file;
    std::span<ChunkRow> rows;
    int read_fd = -1;
    EarlyWriteBack early;
    std::uint64_t written = 0;
    int ranged = kFirstRangeLevel;  ///< the next level whose ranges are to be written
    bool named = false;             ///< the label names were written
    std::optional<CurvedNodes> curved;
    mutable std::mutex hdf5;

    Impl(const std::filesystem::path& target, const StoreHeader& header, bool force,
         ChunkWriting chunks)
        : path(target),
          unfinished(target, force),
          layout(header),
          is_planned(chunks == ChunkWriting::elsewhere),
          rows_file(target.parent_path()) {
        rows_file.map(layout.rows() * sizeof(ChunkRow));
        rows = rows_file.as<ChunkRow>();
    }

    [[noreturn]] void fail(const std::string& what) const { fail_writing(path, what); }
    /// Valid as long as the file is open.
    [[nodiscard]] WrittenFile written_file() const { return {file.get(), path}; }

    void create();
    void create_array(const ArrayInfo& array);
    void write_vtk_group() const;
    void write_table() const;
};

void StoreWriter::Impl::create() {
    const QuietHdf5 quiet;
    register_zstd_filter();
    const PropertyHandle access = written_file_access();
    // Chunks are then allocated one by one at the end of the file: see write_chunk().
    H5Pset_small_data_block_size(access.get(), 0);
    if (is_planned) {
        use_planned_writes(access, planned);
    }
    file = create_hdf5(unfinished.name(), access);
    if (!file.valid()) {
        fail("create the file");
    }
    unfinished.created();
    datasets.resize(layout.all_arrays().size());
    const WrittenFile out = written_file();
    out.create_group("/levels");
    for (int level = 0; level <= layout.lattice().top(); ++level) {
        out.create_group(fmt::format("/levels/{}", level));
    }
    if (layout.header().curved) {
        out.create_group("/positions");
    }
    for (const ArrayInfo& array : layout.all_arrays()) {
        create_array(array);
    }
    write_header(file.get(), layout.header());
    if (!layout.header().labels) {
        write_vtk_group();  // VTK would show the codes of labels
    }
    read_fd = ::open(unfinished.name().c_str(), O_RDONLY | O_CLOEXEC);
    if (read_fd < 0) {
        throw Error(ErrorKind::io, {unfinished.name().string()},
                    fmt::format("cannot read back: {}", std::strerror(errno)));
    }
}

void StoreWriter::Impl::create_array(const ArrayInfo& array) {
    const std::string name = StoreLayout::path_of(array);
    if (array.alias) {
        const std::string target =
            StoreLayout::path_of(layout.array(array.level, source_at_level_1(array.field)));
        if (H5Lcreate_hard(file.get(), target.c_str(), file.get(), name.c_str(), H5P_DEFAULT,
                           H5P_DEFAULT) < 0) {
            fail("link " + name);
        }
        return;
    }
    const auto dims = dims_of(array.nodes, array.components);
    const auto chunk = dims_of(array.chunk, array.components);
    const SpaceHandle space(H5Screate_simple(rank_of(array), dims.data(), nullptr));
    const PropertyHandle creation(H5Pcreate(H5P_DATASET_CREATE));
    H5Pset_obj_track_times(creation.get(), false);
    H5Pset_chunk(creation.get(), rank_of(array), chunk.data());
    H5Pset_fill_time(creation.get(), H5D_FILL_TIME_NEVER);
    if (array.codec.shuffle) {
        H5Pset_shuffle(creation.get());
    }
    const auto level = static_cast<unsigned>(array.codec.level);
    H5Pset_filter(creation.get(), kZstdFilter, H5Z_FLAG_MANDATORY, 1, &level);
    const TypeHandle type = array.coordinate >= 0          ? file_type(layout.header().curved->type)
                            : array.field == Field::values ? file_type(layout.header().type)
                            : layout.header().exact        ? file_type(ValueType::f32)
                                                           : indicator_code_type();
    DatasetHandle dataset(H5Dcreate2(file.get(), name.c_str(), type.get(), space.get(), H5P_DEFAULT,
                                     creation.get(), H5P_DEFAULT));
    if (!dataset.valid()) {
        fail("create a dataset");
    }
    write_attribute(dataset.get(), "first_chunk_row", array.first_row);
    datasets[static_cast<std::size_t>(&array - layout.all_arrays().data())] = std::move(dataset);
}

void StoreWriter::Impl::write_vtk_group() const {
    if (layout.header().uneven || layout.header().curved) {
        return;  // VTKHDF has no such grids
    }
    const WrittenFile out = written_file();
    const GroupHandle group = out.create_group("/VTKHDF");
    const GroupHandle points = out.create_group("/VTKHDF/PointData");
    write_vtk_attributes(group.get(), layout.header());
    write_attribute(points.get(), "Scalars", std::string("values"));
    if (H5Lcreate_hard(file.get(), "/levels/0/values", points.get(), "values", H5P_DEFAULT,
                       H5P_DEFAULT) < 0) {
        fail("link /VTKHDF/PointData/values");
    }
}

void StoreWriter::Impl::write_table() const {
    double low = std::numeric_limits<double>::infinity();
    double high = -low;
    std::uint32_t missing = 0;
    for (const ArrayInfo& array : layout.arrays()) {
        if (array.level != 0) {
            continue;
        }
        for (const ChunkRow& row :
             rows.subspan(array.first_row, static_cast<std::size_t>(array.grid.product()))) {
            low = std::fmin(low, row.min);
            high = std::fmax(high, row.max);
            missing |= row.flags & kChunkHasMissing;
        }
    }
    StoreHeader header = layout.header();
    header.skips_shuffle = std::any_of(rows.begin(), rows.end(), [](const ChunkRow& row) {
        return (row.flags & kChunkUnshuffled) != 0;
    });
    write_version_and_flags(file.get(), header);
    if (curved) {
        write_curved(file.get(), *curved);
    }
    write_attribute(file.get(), "range", std::vector<double>{low, high});
    write_attribute(file.get(), "has_missing", missing);
    const std::optional<std::uint64_t> digest = header_digest(file.get());
    if (!digest) {
        fail("read back the header");
    }
    write_attribute(file.get(), "xxh64", *digest);
    const std::array<hsize_t, 1> count{rows.size()};
    const WrittenFile out = written_file();
    DatasetHandle table = out.write_whole("/chunks", chunk_row_type().get(), count, rows.data());
    write_attribute(table.get(), "xxh64", checksum_of(std::as_bytes(rows)));
    out.close(std::move(table), "/chunks");
    write_attribute(file.get(), "complete", std::uint32_t{1});
}

void leave_hdf5_alone_at_exit() {
    close_nothing_at_exit();
}

StoreWriter::StoreWriter(const std::filesystem::path& path, const StoreHeader& header, bool force,
                         ChunkWriting chunks) {
    impl_ = std::make_unique<Impl>(path, header, force, chunks);
    try {
        impl_->create();
    } catch (...) {
        impl_->datasets.clear();
        impl_->file.reset();
        throw;
    }
}

StoreWriter::~StoreWriter() {
    if (impl_->read_fd >= 0) {
        ::close(impl_->read_fd);
    }
    const QuietHdf5 quiet;
    impl_->datasets.clear();
    impl_->file.reset();
}

const StoreLayout& StoreWriter::layout() const {
    return impl_->layout;
}

std::uint64_t StoreWriter::bytes_written() const {
    const std::lock_guard lock(impl_->hdf5);
    return impl_->written;
}

void StoreWriter::write_chunk(const ArrayInfo& array, const Int3& chunk,
                              std::span<const std::byte> encoded, ChunkRow row) {
    const auto at = dims_of(array.first_node(chunk), 0);
    const auto index = static_cast<std::size_t>(&array - impl_->layout.all_arrays().data());
    row.bytes = static_cast<std::uint32_t>(encoded.size());
    row.checksum = checksum_of(encoded);
    {
        const std::lock_guard lock(impl_->hdf5);
        const QuietHdf5 quiet;
        const hid_t dataset = impl_->datasets[index].get();
        // Asking HDF5 for a chunk's address searches its index, O(chunks) for each chunk. A new
        // chunk is allocated at the end of the file, so its address is the file size before the
        // write. Reading the bytes back verifies this; if it does not hold (the first chunk of an
        // index), HDF5 is asked.
        hsize_t end = 0;
        H5Fget_filesize(impl_->file.get(), &end);
        if (H5Dwrite_chunk(dataset, H5P_DEFAULT, array.filter_mask(row), at.data(), encoded.size(),
                           encoded.data()) < 0) {
            impl_->fail("write " + array.place(chunk));
        }
        impl_->written += encoded.size();
        std::array<std::byte, 64> back{};
        const std::size_t probe = std::min(back.size(), encoded.size());
        const std::size_t tail = encoded.size() - probe;
        const auto matches = [&](std::size_t part) {
            return ::pread(impl_->read_fd, back.data(), probe, static_cast<off_t>(end + part)) ==
                       static_cast<ssize_t>(probe) &&
                   std::memcmp(back.data(), encoded.data() + part, probe) == 0;
        };
        if (matches(0) && matches(tail)) {
            row.offset = end;
        } else {
            unsigned mask = 0;
            haddr_t address = HADDR_UNDEF;
            hsize_t size = 0;
            if (H5Dget_chunk_info_by_coord(dataset, at.data(), &mask, &address, &size) < 0 ||
                address == HADDR_UNDEF || size != encoded.size()) {
                impl_->fail("find " + array.place(chunk) + " after writing it");
            }
            row.offset = address;
        }
    }
    impl_->rows[array.row_of(chunk)] = row;
    impl_->early.wrote(impl_->read_fd, encoded.size());
}

std::span<ChunkRow> StoreWriter::rows() {
    return impl_->rows;
}

void StoreWriter::plan_chunk(const ArrayInfo& array, const Int3& chunk) {
    const auto at = dims_of(array.first_node(chunk), 0);
    const auto index = static_cast<std::size_t>(&array - impl_->layout.all_arrays().data());
    ChunkRow& row = impl_->rows[array.row_of(chunk)];
    const std::lock_guard lock(impl_->hdf5);
    const QuietHdf5 quiet;
    if (impl_->nothing_bytes < row.bytes) {
        impl_->nothing_bytes = row.bytes;
        impl_->nothing = std::make_unique_for_overwrite<std::byte[]>(row.bytes);
    }
    impl_->planned.drops_raw = true;
    const bool good =
        H5Dwrite_chunk(impl_->datasets[index].get(), H5P_DEFAULT, array.filter_mask(row), at.data(),
                       row.bytes, impl_->nothing.get()) >= 0;
    impl_->planned.drops_raw = false;
    if (!good) {
        impl_->fail("plan " + array.place(chunk));
    }
    row.offset = impl_->planned.last;
    impl_->written += row.bytes;
}

ChunkRow StoreWriter::row(const ArrayInfo& array, const Int3& chunk) const {
    return impl_->rows[array.row_of(chunk)];
}

void StoreWriter::decode(const ArrayInfo& array, const Int3& chunk,
                         std::span<std::byte> raw) const {
    const ChunkRow& row = impl_->rows[array.row_of(chunk)];
    thread_local std::vector<std::byte> stored;
    stored.resize(row.bytes);
    if (::pread(impl_->read_fd, stored.data(), stored.size(), static_cast<off_t>(row.offset)) !=
        static_cast<ssize_t>(stored.size())) {
        throw Error(ErrorKind::io, {impl_->unfinished.name().string(), array.place(chunk)},
                    fmt::format("cannot read back: {}", std::strerror(errno)));
    }
    decode_chunk(stored, array.codec_of(row), raw,
                 {impl_->unfinished.name().string(), array.place(chunk)});
}

void StoreWriter::write_cube_ranges(int level, std::span<const CubeRange> ranges) {
    const QuietHdf5 quiet;
    const std::lock_guard lock(impl_->hdf5);
    write_ranges_of_cubes(impl_->written_file(), impl_->layout, level, ranges);
    impl_->ranged = level + 1;
}

void StoreWriter::set_curved(const CurvedNodes& nodes) {
    impl_->curved = nodes;
}

void StoreWriter::write_label_names(std::span<const LabelName> names) {
    const QuietHdf5 quiet;
    const std::lock_guard lock(impl_->hdf5);
    write_names_of_labels(impl_->written_file(), names);
    impl_->named = true;
}

const std::filesystem::path& StoreWriter::temporary() const {
    return impl_->unfinished.name();
}

void StoreWriter::keep() {
    impl_->unfinished.keep();
}

void StoreWriter::finish() {
    const QuietHdf5 quiet;
    for (const ChunkRow& row : impl_->rows) {
        if (row.bytes == 0) {
            throw Error(ErrorKind::io, {impl_->path.string()},
                        "a chunk was never written; this is a bug");
        }
    }
    if (impl_->layout.has_cube_ranges(impl_->ranged)) {
        throw Error(ErrorKind::io, {impl_->path.string()},
                    "ranges of cubes were never written; this is a bug");
    }
    if (impl_->layout.header().label_names != impl_->named) {
        throw Error(ErrorKind::io, {impl_->path.string()},
                    "names of labels were not written as the header says; this is a bug");
    }
    if ((impl_->layout.header().curved != nullptr) != impl_->curved.has_value()) {
        throw Error(ErrorKind::io, {impl_->path.string()},
                    "positions were not written as the header says; this is a bug");
    }
    impl_->write_table();
    const auto catalogue = make_catalogue(impl_->file.get(), impl_->layout,
                                          std::as_bytes(std::span<const ChunkRow>(impl_->rows)));
    if (!catalogue) {
        impl_->fail("read back what the catalogue is made of");
    }
    bool closed = true;
    for (DatasetHandle& dataset : impl_->datasets) {
        closed = (!dataset.valid() || dataset.close()) && closed;
    }
    closed = impl_->file.close() && closed;
    if (!closed) {
        impl_->fail("close the file");
    }
    append_footer(impl_->unfinished.name(), *catalogue, impl_->path);
    impl_->unfinished.publish();
}

}  // namespace isonest::detail
