#include "preprocess/sources/hdf5/hdf5_datasets.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <set>

#include <isonest/error.h>

#include "preprocess/sources/hdf5/hdf5_files.h"
#include "preprocess/sources/hdf5/hdf5_place.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {

std::vector<std::string> parts_of_path(const std::string& path) {
    std::vector<std::string> parts;
    for (std::size_t at = 0; at < path.size();) {
        const std::size_t end = std::min(path.find('/', at), path.size());
        if (end > at) {
            parts.push_back(path.substr(at, end - at));
        }
        at = end + 1;
    }
    return parts;
}

ObjectHandle open_inside(hid_t from, const std::string& path) {
    const QuietHdf5 quiet;
    ObjectHandle at(H5Oopen(from, ".", H5P_DEFAULT));
    for (const std::string& part : parts_of_path(path)) {
        H5L_info_t link{};
        if (!is_group(at) || H5Lexists(at.get(), part.c_str(), H5P_DEFAULT) <= 0 ||
            H5Lget_info(at.get(), part.c_str(), &link, H5P_DEFAULT) < 0 ||
            link.type != H5L_TYPE_HARD) {
            return {};
        }
        ObjectHandle next(H5Oopen(at.get(), part.c_str(), H5P_DEFAULT));
        at = std::move(next);
    }
    return at;
}

bool is_group(const ObjectHandle& object) {
    return object.valid() &&
           (H5Iget_type(object.get()) == H5I_GROUP || H5Iget_type(object.get()) == H5I_FILE);
}

bool is_dataset(const ObjectHandle& object) {
    return object.valid() && H5Iget_type(object.get()) == H5I_DATASET;
}

std::vector<std::string> names_inside(hid_t group, std::size_t most) {
    const QuietHdf5 quiet;
    std::vector<std::string> names;
    H5G_info_t info{};
    if (H5Gget_info(group, &info) < 0) {
        return names;
    }
    for (hsize_t i = 0; i < std::min<hsize_t>(info.nlinks, most); ++i) {
        const ssize_t length =
            H5Lget_name_by_idx(group, ".", H5_INDEX_NAME, H5_ITER_INC, i, nullptr, 0, H5P_DEFAULT);
        constexpr ssize_t kLongest = 4096;
        if (length <= 0 || length > kLongest) {
            continue;
        }
        std::string name(static_cast<std::size_t>(length) + 1, '\0');
        H5Lget_name_by_idx(group, ".", H5_INDEX_NAME, H5_ITER_INC, i, name.data(), name.size(),
                           H5P_DEFAULT);
        name.pop_back();
        names.push_back(std::move(name));
    }
    return names;
}

std::vector<double> numbers_inside(hid_t from, const std::string& path, std::size_t most) {
    const QuietHdf5 quiet;
    const ObjectHandle dataset = open_inside(from, path);
    if (!is_dataset(dataset) || !holds_its_values(dataset.get())) {
        return {};
    }
    const SpaceHandle space(H5Dget_space(dataset.get()));
    const TypeHandle type(H5Dget_type(dataset.get()));
    const H5T_class_t kind = H5Tget_class(type.get());
    const hssize_t count = H5Sget_simple_extent_npoints(space.get());
    if ((kind != H5T_INTEGER && kind != H5T_FLOAT) || count < 1 ||
        static_cast<std::size_t>(count) > most) {
        return {};
    }
    std::vector<double> numbers(static_cast<std::size_t>(count));
    if (H5Dread(dataset.get(), H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, numbers.data()) <
        0) {
        return {};
    }
    return numbers;
}

std::string joined_text(hid_t object, const char* name) {
    constexpr std::size_t kMax = 4096;
    const QuietHdf5 quiet;
    const AttributeHandle attribute(H5Aopen(object, name, H5P_DEFAULT));
    if (!attribute.valid()) {
        return "";
    }
    const TypeHandle type(H5Aget_type(attribute.get()));
    const SpaceHandle space(H5Aget_space(attribute.get()));
    const hssize_t count = H5Sget_simple_extent_npoints(space.get());
    const std::size_t size = H5Tget_size(type.get());
    if (H5Tget_class(type.get()) != H5T_STRING || H5Tis_variable_str(type.get()) > 0 || count < 1 ||
        size < 1 || size > kMax || static_cast<std::size_t>(count) > kMax / size) {
        return text_of_attribute(object, name);
    }
    std::string text(static_cast<std::size_t>(count) * size, '\0');
    if (H5Aread(attribute.get(), type.get(), text.data()) < 0) {
        return "";
    }
    std::erase(text, '\0');
    text.erase(0, text.find_first_not_of(' '));
    text.erase(text.find_last_not_of(' ') + 1);
    return text;
}

std::optional<Double3> three_of_attribute(hid_t object, const std::string& name) {
    const std::vector<double> numbers = numbers_of_attribute(object, name);
    return numbers.size() == 3 ? std::optional(Double3{numbers[0], numbers[1], numbers[2]})
                               : std::nullopt;
}

namespace {

/// Maximum number of datasets to examine: some seconds of work.
constexpr std::size_t kMaxSeen = 200000;
/// Maximum number that a message lists.
constexpr std::size_t kMaxListed = 40;

struct Candidate {
    std::string path;
    std::string description;
    std::size_t axes = 0;  ///< 0: not a volume
};

/// The datasets of a file: those with the most axes, and the first of the others.
struct Listing {
    std::vector<Candidate> best;
    std::vector<Candidate> others;
    std::size_t count = 0;
    std::size_t count_best = 0;  ///< including those not in `best`
    std::size_t count_wide = 0;  ///< with more than 3 axes
    std::string wide;            ///< the first of them
    bool whole = true;
    std::set<haddr_t> seen;

    [[nodiscard]] std::size_t axes() const { return best.empty() ? 0 : best.front().axes; }

    void add(Candidate c) {
        ++count;
        if (c.axes > axes()) {
            for (Candidate& old : best) {
                keep(others, std::move(old));
            }
            best.clear();
            count_best = 0;
        }
        const bool is_best = c.axes > 0 && (best.empty() || c.axes == axes());
        count_best += is_best ? 1 : 0;
        keep(is_best ? best : others, std::move(c));
    }

    [[nodiscard]] std::string text() const {
        std::string text;
        std::size_t left = kMaxListed;
        for (const std::vector<Candidate>* list : {&best, &others}) {
            for (const Candidate& c : *list) {
                if (left > 0) {
                    text += "\n  " + c.description;
                    --left;
                }
            }
        }
        if (count > kMaxListed) {
            text += fmt::format("\n  and {} more", count - kMaxListed);
        }
        return text.empty() ? " none" : text;
    }

  private:
    static void keep(std::vector<Candidate>& list, Candidate c) {
        if (list.size() < kMaxListed) {
            list.push_back(std::move(c));
        }
    }
};

herr_t list_dataset(hid_t file, const char* name, const H5O_info_t* info, void* data) {
    auto& listing = *static_cast<Listing*>(data);
    if (info->type != H5O_TYPE_DATASET || !listing.seen.insert(info->addr).second) {
        return 0;
    }
    if (listing.count >= kMaxSeen) {
        listing.whole = false;
        return 1;
    }
    Candidate c;
    c.path = std::string("/") + name;
    const DatasetHandle dataset(H5Dopen2(file, name, H5P_DEFAULT));
    if (dataset.valid()) {
        const DatasetShape shape = shape_of(dataset.get());
        const auto type = value_type_of(dataset.get());
        c.axes = type && !is_dimension_scale(dataset.get()) ? shape.axes.size() : 0;
        if (type && shape.axes.empty() && !shape.dims.empty() && listing.count_wide++ == 0) {
            listing.wide = c.path;
        }
        c.description = fmt::format("{} [{}] {}", c.path, shape.text(),
                                    type ? name_of(*type) : "of an unsupported type");
    } else {
        c.description = c.path + ": HDF5 cannot open it";
    }
    listing.add(std::move(c));
    return 0;
}

Listing list_datasets(hid_t file, const std::filesystem::path& path) {
    Listing listing;
    if (H5Ovisit2(file, H5_INDEX_NAME, H5_ITER_INC, &list_dataset, &listing, H5O_INFO_BASIC) < 0) {
        throw Error(ErrorKind::corrupt, {path.string()},
                    fmt::format("HDF5 cannot list its datasets: {}", hdf5_message()));
    }
    return listing;
}

}  // namespace

std::optional<ValueType> value_type_of(hid_t dataset) {
    TypeHandle type(H5Dget_type(dataset));
    if (H5Tget_class(type.get()) == H5T_ENUM) {
        type = TypeHandle(H5Tget_super(type.get()));
    }
    const std::size_t size = H5Tget_size(type.get());
    if (H5Tget_class(type.get()) == H5T_FLOAT) {
        return size <= 4   ? std::optional(ValueType::f32)
               : size <= 8 ? std::optional(ValueType::f64)
                           : std::nullopt;
    }
    if (H5Tget_class(type.get()) != H5T_INTEGER || size > 8 || size == 3) {
        return std::nullopt;
    }
    if (size > 4) {
        return ValueType::f64;
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

std::string DatasetShape::text() const {
    return fmt::format("{}", fmt::join(dims, ", "));
}

Int3 DatasetShape::along_axes(const std::vector<hsize_t>& numbers) const {
    Int3 out{1, 1, 1};
    int axis = 0;
    for (std::size_t i = axes.size(); i-- > 0;) {
        out[axis++] = static_cast<std::int64_t>(numbers[axes[i]]);
    }
    return out;
}

std::vector<hsize_t> DatasetShape::along_dims(const Int3& numbers, hsize_t otherwise) const {
    std::vector<hsize_t> out(dims.size(), otherwise);
    int axis = 0;
    for (std::size_t i = axes.size(); i-- > 0;) {
        out[axes[i]] = static_cast<hsize_t>(numbers[axis++]);
    }
    return out;
}

std::vector<hsize_t> DatasetShape::place_of(const Int3& node) const {
    std::vector<hsize_t> out = along_dims(node, 0);
    for (std::size_t i = 0; i < at.size(); ++i) {
        out[i] += at[i];
    }
    return out;
}

DatasetShape shape_of(hid_t dataset) {
    DatasetShape shape;
    const SpaceHandle space(H5Dget_space(dataset));
    const int rank = H5Sget_simple_extent_ndims(space.get());
    if (rank < 1) {
        return shape;
    }
    shape.dims.resize(static_cast<std::size_t>(rank));
    H5Sget_simple_extent_dims(space.get(), shape.dims.data(), nullptr);
    constexpr std::size_t kMaxAxes = 3;
    std::size_t surplus = shape.dims.size() - std::min(shape.dims.size(), kMaxAxes);
    for (std::size_t i = 0; i < shape.dims.size(); ++i) {
        if (surplus > 0 && shape.dims[i] == 1) {
            --surplus;
        } else {
            shape.axes.push_back(i);
        }
    }
    if (surplus > 0) {
        shape.axes.clear();
    }
    return shape;
}

haddr_t offset_of_values(hid_t dataset) {
    // After a user block, H5Dget_offset() adds its size to HADDR_UNDEF.
    return H5Dget_storage_size(dataset) > 0 ? H5Dget_offset(dataset) : HADDR_UNDEF;
}

std::optional<hsize_t> stored_size_of_chunk(hid_t dataset, const std::vector<hsize_t>& at) {
    // H5Dget_chunk_info_by_coord() visits all chunks, and HDF5 1.10 returns wrong results if an
    // axis other than the first can grow.
    hsize_t size = 0;
    if (H5Dget_chunk_storage_size(dataset, at.data(), &size) >= 0) {
        return size;
    }
    // HDF5 1.10 fails if no chunk of the dataset was ever written.
    return hdf5_message() == "chunk storage is not allocated" ? std::optional<hsize_t>(0)
                                                              : std::nullopt;
}

std::string choose_dataset(hid_t file, const std::filesystem::path& path, bool indexed) {
    const Listing listing = list_datasets(file, path);
    if (!listing.whole) {
        throw Error(ErrorKind::invalid_argument, {path.string()},
                    fmt::format("there are more than {} datasets; among them are:{}", kMaxSeen,
                                listing.text()),
                    {{RemedyKind::choose_dataset}});
    }
    // Rows and images stored beside an array with more axes are not the volume.
    constexpr std::size_t kVolume = 3;
    const bool are_wide = indexed || listing.axes() < kVolume;
    if (listing.count_wide == 1 && are_wide) {
        return listing.wide;
    }
    if (listing.count_best != 1 || (listing.count_wide > 1 && are_wide)) {
        const bool none = listing.count_best == 0;
        throw Error(
            none ? ErrorKind::not_found : ErrorKind::invalid_argument, {path.string()},
            fmt::format("{}; the file has:{}",
                        none ? "there is no dataset that is a volume" : "there are several volumes",
                        listing.text()),
            none ? std::vector<Remedy>{} : std::vector<Remedy>{{RemedyKind::choose_dataset}});
    }
    return listing.best.front().path;
}

std::string list_of_datasets(hid_t file, const std::filesystem::path& path) {
    return list_datasets(file, path).text();
}

}  // namespace isonest::detail
