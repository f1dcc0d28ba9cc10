#include "store/exports/volume_file.h"

#include <fmt/format.h>

#include <array>
#include <span>
#include <string_view>
#include <utility>

#include <isonest/error.h>

#include "store/container/hdf5_types.h"
#include "store/container/header_writer.h"
#include "store/exports/volume_headers.h"
#include "store/files/output_file.h"
#include "store/hdf5/handles.h"

namespace isonest::detail {
namespace {

class Hdf5File : public VolumeFile {
  public:
    Hdf5File(std::filesystem::path path, const VolumeFileSpec& spec)
        : path_(std::move(path)), unfinished_(path_, spec.force), spec_(spec) {
        const QuietHdf5 quiet;
        file_ = create_hdf5(unfinished_.name());
        const std::array<hsize_t, 3> dims = shape(spec_.nodes);
        const SpaceHandle space(H5Screate_simple(3, dims.data(), nullptr));
        const PropertyHandle creation(H5Pcreate(H5P_DATASET_CREATE));
        H5Pset_obj_track_times(creation.get(), false);
        H5Pset_fill_time(creation.get(), H5D_FILL_TIME_NEVER);
        const TypeHandle type = numbers_type();
        if (file_.valid()) {
            unfinished_.created();
            data_ = DatasetHandle(H5Dcreate2(file_.get(), "data", type.get(), space.get(),
                                             H5P_DEFAULT, creation.get(), H5P_DEFAULT));
        }
        if (!data_.valid()) {
            fail("create it");
        }
        write_attribute(data_.get(), "spacing",
                        std::vector<double>(spec_.spacing.begin(), spec_.spacing.end()));
        write_attribute(data_.get(), "origin",
                        std::vector<double>(spec_.origin.begin(), spec_.origin.end()));
        if (spec_.direction != kAlongWorld) {
            write_attribute(data_.get(), "direction", vtk_direction(spec_.direction));
        }
        if (spec_.unit) {
            write_attribute(data_.get(), "unit", std::string(symbol_of(*spec_.unit)));
        }
        if (spec_.frame != AnatomicalFrame::unknown) {
            write_attribute(data_.get(), "frame", std::string(name_of(spec_.frame)));
        }
    }
    ~Hdf5File() override {
        const QuietHdf5 quiet;
        data_.reset();
        file_.reset();
    }
    void write(const std::byte* planes, std::int64_t count) override {
        write_box({0, 0, next_}, {spec_.nodes.x, spec_.nodes.y, count}, planes);
        next_ += count;
    }
    void write_box(const Int3& lo, const Int3& size, const std::byte* data) override {
        const QuietHdf5 quiet;
        const std::array<hsize_t, 3> start = shape(lo);
        const std::array<hsize_t, 3> count = shape(size);
        const SpaceHandle to(H5Dget_space(data_.get()));
        H5Sselect_hyperslab(to.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr);
        const SpaceHandle from(H5Screate_simple(3, count.data(), nullptr));
        const TypeHandle type = numbers_type();
        if (H5Dwrite(data_.get(), type.get(), from.get(), to.get(), H5P_DEFAULT, data) < 0) {
            fail("write it");
        }
    }
    void finish() override {
        const QuietHdf5 quiet;
        const bool closed = data_.close();
        if (!file_.close() || !closed) {
            fail("close it");
        }
        unfinished_.publish();
    }

  private:
    [[nodiscard]] TypeHandle numbers_type() const {
        return spec_.is_int64 ? TypeHandle(H5Tcopy(H5T_STD_I64LE)) : file_type(spec_.type);
    }
    [[nodiscard]] static std::array<hsize_t, 3> shape(const Int3& n) {
        return {static_cast<hsize_t>(n.z), static_cast<hsize_t>(n.y), static_cast<hsize_t>(n.x)};
    }
    [[noreturn]] void fail(const char* what) {
        const std::string detail = hdf5_message();
        data_.reset();
        file_.reset();
        throw Error(ErrorKind::io, {path_.string()}, fmt::format("cannot {}: {}", what, detail));
    }
    std::filesystem::path path_;
    UnfinishedFile unfinished_;
    VolumeFileSpec spec_;
    FileHandle file_;
    DatasetHandle data_;
    std::int64_t next_ = 0;
};

class FlatFile : public VolumeFile {
  public:
    FlatFile(const std::filesystem::path& path, const VolumeFileSpec& spec,
             const VolumeHeader& header)
        : file_(path, spec.force), spec_(spec), header_bytes_(header.before.size()) {
        file_.write_at(0, std::as_bytes(std::span(header.before)));
        const auto numbers = static_cast<std::uint64_t>(spec.nodes.product()) * size_of(spec.type);
        if (!header.behind.empty()) {
            file_.write_at(header_bytes_ + numbers, std::as_bytes(std::span(header.behind)));
        }
    }
    void write(const std::byte* planes, std::int64_t count) override {
        write_box({0, 0, next_}, {spec_.nodes.x, spec_.nodes.y, count}, planes);
        next_ += count;
    }
    void write_box(const Int3& lo, const Int3& size, const std::byte* data) override {
        const Int3& n = spec_.nodes;
        const std::size_t element = size_of(spec_.type);
        const bool whole_rows = size.x == n.x;
        const bool whole_planes = whole_rows && size.y == n.y;
        // What follows each other in the file is written at once.
        const Int3 step{size.x, whole_rows ? size.y : 1, whole_planes ? size.z : 1};
        const std::size_t bytes = static_cast<std::size_t>(step.product()) * element;
        for (std::int64_t z = 0; z < size.z; z += step.z) {
            for (std::int64_t y = 0; y < size.y; y += step.y) {
                const auto first = static_cast<std::uint64_t>(n.linear(lo + Int3{0, y, z}));
                file_.write_at(header_bytes_ + first * element, {data, bytes});
                data += bytes;
            }
        }
    }
    void finish() override { file_.publish_as_named(); }

  private:
    OutputFile file_;
    VolumeFileSpec spec_;
    std::uint64_t header_bytes_;
    std::int64_t next_ = 0;
};

}  // namespace

std::unique_ptr<VolumeFile> create_volume_file(const std::filesystem::path& path,
                                               const VolumeFileSpec& spec) {
    const std::string ending = path.extension().string();
    if (ending == ".h5" || ending == ".hdf5") {
        return std::make_unique<Hdf5File>(path, spec);
    }
    using MakeHeader = VolumeHeader (*)(const VolumeFileSpec&);
    constexpr std::array<std::pair<std::string_view, MakeHeader>, 6> kFlat{
        {{".nrrd", nrrd_file_header},
         {".nii", nifti_file_header},
         {".vti", vti_file_header},
         {".npy", npy_file_header},
         {".mha", meta_image_file_header},
         {".raw", [](const VolumeFileSpec&) { return VolumeHeader{}; }}}};
    for (const auto& [name, make_header] : kFlat) {
        if (ending == name) {
            return std::make_unique<FlatFile>(path, spec, make_header(spec));
        }
    }
    throw Error(ErrorKind::invalid_argument, {path.string()},
                "the name must end in .h5, .nrrd, .nii, .vti, .npy, .mha or .raw");
}

}  // namespace isonest::detail
