#include "preprocess/hdf5_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <set>
#include <vector>

#include "store/error.h"
#include "store/handles.h"
#include "store/hdf5_types.h"
#include "store/lattice.h"
#include "store/mapped_file.h"
#include "store/zstd_filter.h"

namespace isonest {
namespace {

std::optional<ValueType> type_of(hid_t dataset) {
    const TypeHandle type(H5Dget_type(dataset));
    const std::size_t size = H5Tget_size(type.get());
    if (H5Tget_class(type.get()) == H5T_FLOAT) {
        return size == 4   ? std::optional(ValueType::f32)
               : size == 8 ? std::optional(ValueType::f64)
                           : std::nullopt;
    }
    if (H5Tget_class(type.get()) != H5T_INTEGER || size > 4 || size == 3) {
        return std::nullopt;
    }
    const bool is_signed = H5Tget_sign(type.get()) == H5T_SGN_2;
    if (size == 1) {
        return is_signed ? ValueType::i8 : ValueType::u8;
    }
    if (size == 2) {
        return is_signed ? ValueType::i16 : ValueType::u16;
    }
    return is_signed ? ValueType::i32 : ValueType::u32;
}

std::vector<hsize_t> shape_of(hid_t dataset) {
    const SpaceHandle space(H5Dget_space(dataset));
    const int rank = H5Sget_simple_extent_ndims(space.get());
    std::vector<hsize_t> dims(static_cast<std::size_t>(std::max(rank, 0)));
    if (rank > 0) {
        H5Sget_simple_extent_dims(space.get(), dims.data(), nullptr);
    }
    return dims;
}

struct Candidate {
    std::string path;
    std::string description;
    bool usable = false;
};

struct Listing {
    std::vector<Candidate> found;
    std::set<haddr_t> seen;
};

herr_t list_dataset(hid_t file, const char* name, const H5O_info_t* info, void* data) {
    auto& listing = *static_cast<Listing*>(data);
    if (info->type != H5O_TYPE_DATASET || listing.found.size() >= 1000 ||
        !listing.seen.insert(info->addr).second) {
        return 0;
    }
    const DatasetHandle dataset(H5Dopen2(file, name, H5P_DEFAULT));
    if (!dataset.valid()) {
        const std::string path = std::string("/") + name;
        listing.found.push_back({path, path + ": HDF5 cannot open it", false});
        return 0;
    }
    const auto shape = shape_of(dataset.get());
    const auto type = type_of(dataset.get());
    Candidate c;
    c.path = std::string("/") + name;
    c.usable = type.has_value() && !shape.empty() && shape.size() <= 3;
    c.description = fmt::format("{} [{}] {}", c.path, fmt::join(shape, ", "),
                                type ? name_of(*type) : "not a number type that is read");
    listing.found.push_back(std::move(c));
    return 0;
}

std::string text_of(const Listing& listing) {
    std::string text;
    for (const Candidate& c : listing.found) {
        text += "\n  " + c.description;
    }
    return text.empty() ? " none" : text;
}

class Hdf5Source : public VolumeSource {
  public:
    Hdf5Source(const std::filesystem::path& path, const SourceOptions& options) : path_(path) {
        const QuietHdf5 quiet;
        register_zstd_filter();
        file_ = open_hdf5(path);
        if (!file_.valid()) {
            throw Error(ErrorKind::corrupt,
                        fmt::format("{}: HDF5 cannot open it: {}", path.string(), hdf5_message()));
        }
        choose(path, options);
        const auto shape = shape_of(dataset_.get());
        const auto type = type_of(dataset_.get());
        if (!type || shape.empty() || shape.size() > 3) {
            throw Error(ErrorKind::unsupported,
                        fmt::format("{}: volumes of one scalar (integers of 8 to 32 bits, float, "
                                    "double) on 1 to 3 axes are read, this is [{}] {}",
                                    name_, fmt::join(shape, ", "),
                                    type ? name_of(*type) : "of another type"));
        }
        type_ = *type;
        for (std::size_t i = 0; i < shape.size(); ++i) {
            const hsize_t n = shape[shape.size() - 1 - i];
            if (n < 1 || n > static_cast<hsize_t>(kMaxNodesPerAxis)) {
                throw Error(ErrorKind::unsupported,
                            fmt::format("{}: [{}] nodes: each axis must have 1 to {}", name_,
                                        fmt::join(shape, ", "), kMaxNodesPerAxis));
            }
            nodes_[static_cast<int>(i)] = static_cast<std::int64_t>(n);
        }
        rank_ = static_cast<int>(shape.size());
        set_chunks(path, options);
        if (const auto s = read_numbers(dataset_.get(), "spacing", 3)) {
            spacing_ = {(*s)[0], (*s)[1], (*s)[2]};
        }
        if (const auto o = read_numbers(dataset_.get(), "origin", 3)) {
            origin_ = {(*o)[0], (*o)[1], (*o)[2]};
        }
        memory_type_ = native(type_);
        map_contiguous(path);
    }

    [[nodiscard]] Int3 nodes() const override { return nodes_; }
    [[nodiscard]] ValueType type() const override { return type_; }
    [[nodiscard]] Double3 spacing() const override { return spacing_; }
    [[nodiscard]] Double3 origin() const override { return origin_; }
    [[nodiscard]] std::string name() const override { return name_; }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override { return {path_}; }
    [[nodiscard]] Granularity granularity() const override { return granularity_; }
    [[nodiscard]] bool sequential() const override { return false; }
    [[nodiscard]] std::uint64_t heap() const override { return heap_; }
    [[nodiscard]] std::span<const std::byte> mapped() const override { return mapped_; }

    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        const QuietHdf5 quiet;
        const std::array<hsize_t, 3> start{static_cast<hsize_t>(z0), static_cast<hsize_t>(y0), 0};
        const std::array<hsize_t, 3> count{static_cast<hsize_t>(nz), static_cast<hsize_t>(ny),
                                           static_cast<hsize_t>(nodes_.x)};
        const auto skip = static_cast<std::size_t>(3 - rank_);
        const SpaceHandle from(H5Dget_space(dataset_.get()));
        H5Sselect_hyperslab(from.get(), H5S_SELECT_SET, start.data() + skip, nullptr,
                            count.data() + skip, nullptr);
        const SpaceHandle to(H5Screate_simple(rank_, count.data() + skip, nullptr));
        if (H5Dread(dataset_.get(), memory_type_, to.get(), from.get(), H5P_DEFAULT, dst) < 0) {
            throw Error(ErrorKind::io, fmt::format("{}: cannot read planes {} to {}: {}", name_, z0,
                                                   z0 + nz - 1, hdf5_message()));
        }
    }

  private:
    static hid_t native(ValueType type) {
        switch (type) {
            case ValueType::u8:
                return H5T_NATIVE_UINT8;
            case ValueType::i8:
                return H5T_NATIVE_INT8;
            case ValueType::u16:
                return H5T_NATIVE_UINT16;
            case ValueType::i16:
                return H5T_NATIVE_INT16;
            case ValueType::u32:
                return H5T_NATIVE_UINT32;
            case ValueType::i32:
                return H5T_NATIVE_INT32;
            case ValueType::f32:
                return H5T_NATIVE_FLOAT;
            case ValueType::f64:
                break;
        }
        return H5T_NATIVE_DOUBLE;
    }

    void choose(const std::filesystem::path& path, const SourceOptions& options) {
        std::string dataset = options.dataset;
        Listing listing;
        if (dataset.empty() ||
            !(dataset_ = DatasetHandle(H5Dopen2(file_.get(), dataset.c_str(), H5P_DEFAULT)))
                 .valid()) {
            if (H5Ovisit2(file_.get(), H5_INDEX_NAME, H5_ITER_INC, &list_dataset, &listing,
                          H5O_INFO_BASIC) < 0) {
                throw Error(ErrorKind::corrupt, fmt::format("{}: HDF5 cannot list its datasets: {}",
                                                            path.string(), hdf5_message()));
            }
            if (!dataset.empty()) {
                throw Error(ErrorKind::not_found,
                            fmt::format("{}: there is no dataset {}; the file has:{}",
                                        path.string(), dataset, text_of(listing)));
            }
            const auto usable = std::count_if(listing.found.begin(), listing.found.end(),
                                              [](const Candidate& c) { return c.usable; });
            if (usable != 1) {
                throw Error(usable == 0 ? ErrorKind::not_found : ErrorKind::invalid_argument,
                            fmt::format("{}: {}; the file has:{}", path.string(),
                                        usable == 0 ? "no dataset that is a volume"
                                                    : "several volumes, choose one with --dataset",
                                        text_of(listing)));
            }
            dataset =
                std::find_if(listing.found.begin(), listing.found.end(), [](const Candidate& c) {
                    return c.usable;
                })->path;
            dataset_ = DatasetHandle(H5Dopen2(file_.get(), dataset.c_str(), H5P_DEFAULT));
        }
        dataset_name_ = dataset;
        name_ = path.string() + ":" + dataset;
    }

    /// Whole rows of chunks are read at a time, so HDF5's chunk cache only has to hold one chunk.
    void set_chunks(const std::filesystem::path& path, const SourceOptions& options) {
        const PropertyHandle creation(H5Dget_create_plist(dataset_.get()));
        if (H5Pget_layout(creation.get()) != H5D_CHUNKED) {
            return;
        }
        std::array<hsize_t, 3> chunk{1, 1, 1};
        H5Pget_chunk(creation.get(), rank_, chunk.data() + (3 - rank_));
        const std::uint64_t bytes = chunk[0] * chunk[1] * chunk[2] * size_of(type_);
        if (bytes > options.max_heap) {
            throw Error(ErrorKind::limit,
                        fmt::format("{}: one chunk of {} x {} x {} values takes {} MiB; give more "
                                    "--memory or store the input in smaller chunks",
                                    name_, chunk[2], chunk[1], chunk[0], bytes >> 20U));
        }
        granularity_ = {std::min(nodes_.z, static_cast<std::int64_t>(chunk[0])),
                        std::min(nodes_.y, static_cast<std::int64_t>(chunk[1]))};
        // The cached chunk, and the filters' input and output.
        heap_ += 3 * bytes;
        const PropertyHandle access(H5Pcreate(H5P_DATASET_ACCESS));
        H5Pset_chunk_cache(access.get(), 521, std::max<std::uint64_t>(bytes, 1U << 20U), 1.0);
        dataset_.reset();
        dataset_ = DatasetHandle(H5Dopen2(file_.get(), dataset_name_.c_str(), access.get()));
        if (!dataset_.valid()) {
            throw Error(ErrorKind::io,
                        fmt::format("{}: cannot open: {}", path.string(), hdf5_message()));
        }
    }

    /// A dataset that lies in the file as read() would give it needs no copy.
    void map_contiguous(const std::filesystem::path& path) {
        const PropertyHandle creation(H5Dget_create_plist(dataset_.get()));
        const TypeHandle stored(H5Dget_type(dataset_.get()));
        const haddr_t offset = H5Dget_offset(dataset_.get());
        if (H5Pget_layout(creation.get()) != H5D_CONTIGUOUS || offset == HADDR_UNDEF ||
            H5Pget_external_count(creation.get()) != 0 ||
            H5Tequal(stored.get(), memory_type_) <= 0 || offset % size_of(type_) != 0) {
            return;
        }
        const auto bytes = static_cast<std::uint64_t>(nodes_.product()) * size_of(type_);
        map_.emplace(path);
        if (map_->bytes().size() < bytes || map_->bytes().size() - bytes < offset) {
            throw Error(ErrorKind::corrupt,
                        fmt::format("{}: the file ends before the dataset does", name_));
        }
        mapped_ = map_->bytes().subspan(offset, bytes);
    }

    std::filesystem::path path_;
    FileHandle file_;
    DatasetHandle dataset_;
    std::string dataset_name_;
    std::string name_;
    Int3 nodes_{1, 1, 1};
    ValueType type_ = ValueType::f32;
    Double3 spacing_{1, 1, 1};
    Double3 origin_{0, 0, 0};
    Granularity granularity_;
    int rank_ = 3;
    std::optional<MappedFile> map_;
    std::span<const std::byte> mapped_;
    std::uint64_t heap_ = 2U << 20U;
    hid_t memory_type_ = H5I_INVALID_HID;
};

}  // namespace

std::unique_ptr<VolumeSource> open_hdf5_volume(const std::filesystem::path& path,
                                               const SourceOptions& options) {
    return std::make_unique<Hdf5Source>(path, options);
}

}  // namespace isonest
