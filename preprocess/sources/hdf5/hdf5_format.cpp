#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <memory>
#include <string_view>
#include <vector>

#include <isonest/error.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/hdf5/hdf5_chunks.h"
#include "preprocess/sources/hdf5/hdf5_datasets.h"
#include "preprocess/sources/hdf5/hdf5_dialects.h"
#include "preprocess/sources/hdf5/hdf5_files.h"
#include "preprocess/sources/hdf5/hdf5_place.h"
#include "preprocess/sources/hdf5/lzf_filter.h"
#include "preprocess/sources/numbers/raw_rows.h"
#include "preprocess/sources/placement/axis_choice.h"
#include "preprocess/sources/placement/conventions.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/volume_format.h"
#include "preprocess/sources/wrapping/cropped_source.h"
#include "preprocess/sources/wrapping/label_names.h"
#include "preprocess/sources/wrapping/scaled_source.h"
#include "store/container/parts/hdf5_types.h"
#include "store/files/open_file.h"
#include "store/hdf5/file_drivers.h"
#include "store/hdf5/handles.h"
#include "store/hdf5/zstd_filter.h"
#include "store/lattice/lattice.h"

namespace isonest::detail {
namespace {

constexpr std::array<char, 8> kSignature{'\x89', 'H', 'D', 'F', '\r', '\n', '\x1a', '\n'};

/// Where HDF5 begins in a file: after a user block of 0 or 512 * 2^k bytes.
std::optional<std::uint64_t> start_of_hdf5(const InputFile& file) {
    constexpr std::uint64_t kMin = 512;
    constexpr std::uint64_t kFar = std::uint64_t{64} << 10U;
    const std::uint64_t size =
        file.is_remote() ? std::min(regular_file_size(file), kFar) : regular_file_size(file);
    for (std::uint64_t at = 0; at + kSignature.size() <= size; at = at == 0 ? kMin : 2 * at) {
        if (first_bytes(file, kSignature.size(), at) ==
            std::string_view(kSignature.data(), kSignature.size())) {
            return at;
        }
    }
    return std::nullopt;
}

/// Whether the file is marked as open for writing by a program, which may have crashed.
bool is_being_written(const InputFile& file) {
    constexpr std::size_t kVersion = 8;
    constexpr std::size_t kFlags = 11;
    constexpr int kWriting = 1 | 4;
    const auto start = start_of_hdf5(file);
    const std::string bytes = start ? first_bytes(file, kFlags + 1, *start) : "";
    return bytes.size() > kFlags && bytes[kVersion] == 3 && (bytes[kFlags] & kWriting) != 0;
}

class Hdf5Source : public VolumeSource {
  public:
    Hdf5Source(const InputFile& input, const SourceOptions& options) : input_(input) {
        const QuietHdf5 quiet;
        register_zstd_filter();
        register_lzf_filter();
        file_ = input.is_remote() ? open_hdf5(input.bytes()) : open_hdf5(input.path());
        if (!file_.valid() && is_being_written(input)) {
            throw Error(ErrorKind::io, {input.name()},
                        "the file is open in another program, or was not closed properly; wait "
                        "until it is closed, or, if no program writes it, run h5clear -s");
        }
        if (!file_.valid()) {
            throw Error(ErrorKind::corrupt, {input.name()}, hdf5_cannot_open());
        }
        files_ = local_files({input});
        if (input.is_remote()) {
            reading(file_.get(), [&] { open(options); });
        } else {
            open(options);
        }
    }
    /// The scaling according to the dataset's attributes.
    [[nodiscard]] Scaling scaling() const {
        if (slices_) {
            return {};
        }
        // For a remote file, attributes that cannot be fetched must not be treated as absent.
        return reading(dataset_.get(), [this] { return said_scaling(); });
    }
    /// The scaling according to the dialect, if it specifies one.
    [[nodiscard]] const std::optional<SliceScaling>& slices() const { return slices_; }
    /// The part of the dataset that is the volume, without padding.
    [[nodiscard]] std::array<NodeRange, 3> without_padding() const {
        std::array<NodeRange, 3> part;
        const Int3 n = unpadded_nodes();
        for (std::size_t a = 0; a < 3; ++a) {
            const auto axis = static_cast<int>(a);
            part.at(a).to = n[axis] < nodes_[axis] ? std::optional(n[axis]) : std::nullopt;
        }
        return part;
    }
    /// Axes with decreasing coordinates.
    [[nodiscard]] const std::array<bool, 3>& backward() const { return place_.in_world.backward; }
    [[nodiscard]] const UnevenCoordinates& uneven() const { return place_.uneven; }
    /// The datasets that give the nodes of a curvilinear grid their positions, if any.
    [[nodiscard]] const std::optional<CfPositions>& positions() const { return positions_; }
    /// The coordinates along z, if any.
    [[nodiscard]] const std::vector<double>& heights() const {
        return axes_[shape_.axes.front()].coordinates;
    }
    [[nodiscard]] std::vector<std::string> notes() const override { return notes_; }

    [[nodiscard]] VolumeDescription describe() const override {
        const Placement& in_world = place_.in_world;
        return {nodes_,  type_,       in_world.spacing, in_world.origin, name_, in_world.direction,
                labels_, place_.unit, place_.frame,     time()};
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override { return files_; }
    [[nodiscard]] std::string identity() const override {
        const std::string inputs =
            input_.is_remote() ? identity_of_inputs({input_}) : identity_of(files_);
        return inputs.empty()
                   ? inputs
                   : fmt::format("{}dataset {}\n", inputs, dataset_name_) + text_of_place();
    }
    [[nodiscard]] Granularity granularity() const override { return granularity_; }
    [[nodiscard]] std::uint64_t heap() const override { return heap_; }
    [[nodiscard]] std::span<const std::byte> mapped() const override { return mapped_; }

    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        if (remote_numbers_) {
            remote_numbers_->read(z0, nz, y0, ny, dst);
        } else if (input_.is_remote()) {
            reading(dataset_.get(), [&] { read_remote({z0, nz, y0, ny}, dst); });
        } else if (chunks_) {
            chunks_->read(z0, nz, y0, ny, dst);
        } else {
            read_by_hdf5({z0, nz, y0, ny}, {z0, nz, y0, ny}, dst);
        }
    }

  private:
    /// The position in time, if there is only one axis of times and the volume has one position on
    /// it.
    [[nodiscard]] std::optional<VolumeTime> time() const {
        std::vector<ArrayAxis> axes;
        for (std::size_t i = 0; i < axes_.size() && i < shape_.dims.size(); ++i) {
            axes.push_back({axes_[i].name, static_cast<std::int64_t>(shape_.dims[i])});
        }
        ChosenAxes chosen;
        std::copy(shape_.axes.begin(), shape_.axes.end(), chosen.axis.begin());
        const std::optional<std::size_t> axis = time_axis(axes, chosen);
        if (!axis) {
            return std::nullopt;
        }
        VolumeTime time{{}, {}, axes[*axis].length};
        const std::size_t at = shape_.at.empty() ? 0 : static_cast<std::size_t>(shape_.at[*axis]);
        if (at < axes_[*axis].coordinates.size()) {
            time.value = axes_[*axis].coordinates[at];
            time.unit = axes_[*axis].unit;
        }
        return time;
    }
    [[nodiscard]] Scaling said_scaling() const {
        return cf_scaling(
            [this](const std::string& name) {
                std::vector<double> numbers = numbers_of_attribute(dataset_.get(), name);
                const bool stored = name != "scale_factor" && name != "add_offset";
                for (double& number : numbers) {
                    number += stored && unsigned_ && number < 0
                                  ? std::ldexp(1.0, static_cast<int>(8 * size_of(type_)))
                                  : 0;
                }
                return numbers;
            },
            name_);
    }
    [[nodiscard]] std::string text_of_place() const {
        return shape_.at.empty() ? "" : fmt::format("at {}\n", fmt::join(shape_.at, " "));
    }

    /// Reads with HDF5 what was prefetched, in parts, so that the next parts are requested
    /// meanwhile.
    void read_remote(const Slab& slab, std::byte* dst) {
        if (chunks_) {
            chunks_->read(slab.z0, slab.nz, slab.y0, slab.ny, dst);
            return;
        }
        if (remote_chunks_ == nullptr) {
            read_by_hdf5(slab, slab, dst);
            return;
        }
        const std::int64_t step = remote_chunks_->chunk().y;
        for (std::int64_t y = slab.y0; y < slab.y0 + slab.ny;) {
            const std::int64_t end = std::min((y / step + 1) * step, slab.y0 + slab.ny);
            const Slab part{slab.z0, slab.nz, y, end - y};
            remote_chunks_->begin(part);
            read_by_hdf5(part, slab, dst);
            y = end;
        }
    }

    void open(const SourceOptions& options) {
        dataset_name_ = options.dataset;
        std::vector<AxisIndex> index = options.index;
        if (dataset_name_.empty()) {
            if (auto choice = dialect_choice(file_.get(), input_.name(), index)) {
                dataset_name_ = choice->dataset;
                index = std::move(choice->index);
            } else {
                dataset_name_ = choose_dataset(file_.get(), input_.path(), !index.empty());
            }
        }
        name_ = input_.name() + ":" + dataset_name_;
        std::string reason;
        dataset_ = open_named(&reason);
        if (!dataset_.valid()) {
            throw Error(ErrorKind::not_found, {input_.name()},
                        fmt::format("there is no dataset {} ({}); the file has:{}", dataset_name_,
                                    reason, list_of_datasets(file_.get(), input_.path())));
        }
        shape_ = shape_of(dataset_.get());
        const auto type = value_type_of(dataset_.get());
        // set_chunks() opens the dataset again, with another handle.
        const auto named = [this] {
            return NamedDataset{file_.get(), dataset_.get(), dataset_name_, name_};
        };
        const bool with_spacing = options.spacing.has_value();
        if (type && !shape_.dims.empty()) {
            dialect_ = dialect_of(named(), shape_.dims, with_spacing);
        }
        axes_ = dialect_ ? dialect_->axes : hdf5_axes(dataset_.get(), shape_.dims);
        if (type && (dialect_ || shape_.axes.empty() || !index.empty()) && !shape_.dims.empty()) {
            choose_part(*type, index);
        }
        if (!type || shape_.axes.empty()) {
            throw Error(ErrorKind::unsupported, {name_},
                        fmt::format("the dataset [{}] {} is not supported; a volume has 1 to 3 "
                                    "axes, and integers or floating point numbers of up to 64 bits",
                                    shape_.text(), type ? name_of(*type) : "of another type"));
        }
        type_ = *type;
        memory_type_ = file_type(type_);
        take_unsigned();
        if (std::any_of(shape_.dims.begin(), shape_.dims.end(), [](hsize_t n) {
                return n < 1 || n > static_cast<hsize_t>(kMaxNodesPerAxis);
            })) {
            throw Error(ErrorKind::unsupported, {name_},
                        fmt::format("[{}] nodes: each axis must have 1 to {}", shape_.text(),
                                    kMaxNodesPerAxis));
        }
        nodes_ = shape_.along_axes(shape_.dims);
        if (input_.is_remote()) {
            require_own_values();
        } else {
            add_files_of(dataset_.get(), name_, files_);
        }
        unwritten_is_undefined_ = is_unwritten_undefined();
        heap_ += is_in_order() ? 0 : kTurnedBytes;
        set_chunks(options);
        place_ = dialect_ && !dialect_->steps.empty()
                     ? place_by_dialect(*dialect_, shape_, unpadded_nodes(), with_spacing, name_)
                     : hdf5_place(named(), shape_, axes_, options);
        add_notes(place_.notes);
        // Not where x and y have coordinates along their axes.
        if (!options.spacing && !dialect_ && shape_.axes.size() == 3 && is_in_order() &&
            !place_.said[0] && !place_.said[1] && place_.in_world.direction == kAlongWorld) {
            positions_ = hdf5_positions(named(), nodes_);
        }
        if (!positions_) {
            add_notes(note_of_spacing(place_.said, nodes_, options));
        }
        if (input_.is_remote()) {
            remote_numbers_ = open_remote_contiguous(input_, dataset_.get(), shape_,
                                                     {memory_type_.get(), type_}, name_);
            heap_ += remote_numbers_ ? remote_numbers_->heap() : 0;
        } else {
            map_contiguous();
        }
        take_labels(options.labels);
    }

    void add_notes(const std::vector<std::string>& more) {
        notes_.insert(notes_.end(), more.begin(), more.end());
    }

    DatasetHandle open_named(std::string* reason = nullptr) {
        return input_.is_remote()
                   ? open_remote_dataset(file_.get(), dataset_name_, access_, reason)
                   : open_dataset(file_.get(), dataset_name_, access_, files_, reason);
    }

    void require_own_values() const {
        if (!holds_its_values(dataset_.get())) {
            throw Error(ErrorKind::unsupported, {name_},
                        "the values are in other files or datasets (external storage, or a virtual "
                        "dataset), which are not opened from a URL",
                        {{RemedyKind::download}});
        }
    }

    void choose_part(ValueType type, const std::vector<AxisIndex>& index) {
        std::vector<ArrayAxis> axes;
        for (std::size_t i = 0; i < shape_.dims.size(); ++i) {
            const hsize_t length =
                dialect_ && !dialect_->lengths.empty() ? dialect_->lengths[i] : shape_.dims[i];
            const bool of_volume =
                !dialect_ || dialect_->of_volume.empty() || dialect_->of_volume[i];
            axes.push_back({axes_[i].name, static_cast<std::int64_t>(length), of_volume});
        }
        ChosenAxes chosen = choose_axes(axes, index, name_);
        if (dialect_ && dialect_->by_names) {
            chosen = by_names(chosen, axes);
        }
        add_notes(notes_of(chosen, axes));
        if (dialect_ && chosen.no_space != std::array<bool, 3>{}) {
            dialect_->frame = AnatomicalFrame::unknown;
        }
        shape_.axes.clear();
        bool is_whole = true;
        for (std::size_t a = 3; a-- > 0;) {
            if (chosen.axis.at(a)) {
                shape_.axes.push_back(*chosen.axis.at(a));
            }
        }
        for (std::size_t i = 0; i < axes.size(); ++i) {
            is_whole = is_whole &&
                       (shape_.dims[i] == 1 ||
                        std::find(shape_.axes.begin(), shape_.axes.end(), i) != shape_.axes.end());
        }
        shape_.at.clear();
        if (!is_whole) {
            shape_.at.assign(chosen.at.begin(), chosen.at.end());
        }
        if (dialect_ && dialect_->range) {
            slices_ = minc_scaling(*dialect_->range, axes, chosen, type, name_);
            const std::string note = text_of(*dialect_->range, *slices_, type);
            add_notes(note.empty() ? std::vector<std::string>{} : std::vector{note});
        }
    }

    /// The nodes of the volume without padding.
    [[nodiscard]] Int3 unpadded_nodes() const {
        return shape_.along_axes(dialect_ && !dialect_->lengths.empty() ? dialect_->lengths
                                                                        : shape_.dims);
    }
    /// Whether the dataset has the volume's axes in their order, x fastest.
    [[nodiscard]] bool is_in_order() const {
        return std::is_sorted(shape_.axes.begin(), shape_.axes.end());
    }

    void take_unsigned() {
        const ValueType given = type_;
        unsigned_ = is_said_unsigned(dataset_.get());
        type_ = !unsigned_                ? given
                : given == ValueType::i8  ? ValueType::u8
                : given == ValueType::i16 ? ValueType::u16
                : given == ValueType::i32 ? ValueType::u32
                                          : given;
        unsigned_ = type_ != given;
        if (unsigned_) {
            notes_.emplace_back("stored numbers are read as unsigned (_Unsigned)");
        }
    }

    /// Reads a part of a slab to its place in the slab. The rest of the slab is not changed.
    void read_by_hdf5(const Slab& part, const Slab& slab, std::byte* dst) {
        const QuietHdf5 quiet;
        const std::int64_t nz = part.nz;
        if (unwritten_is_undefined_ && part.y0 == slab.y0) {
            std::memset(dst, 0, static_cast<std::size_t>(nz * slab.ny * nodes_.x) * size_of(type_));
        }
        const Int3 low{0, part.y0, part.z0};
        const Int3 high{nodes_.x, part.y0 + part.ny, part.z0 + nz};
        if (is_in_order()) {
            read_box(low, high, {nodes_.x, slab.ny, nz}, {0, part.y0 - slab.y0, 0}, dst);
        } else {
            turned_.resize(kTurnedBytes);
            read_turned(low, high, slab, dst);
        }
        if (labels_ && part.y0 + part.ny == slab.y0 + slab.ny) {
            to_labels(name_, static_cast<std::size_t>(nz * slab.ny * nodes_.x), dst);
        }
    }

    /// Reads nodes [low, high), in the file's axis order, to node `at` of a box of `size` nodes.
    void read_box(const Int3& low, const Int3& high, const Int3& size, const Int3& at,
                  std::byte* dst) {
        const std::vector<hsize_t> start = shape_.place_of(low);
        const std::vector<hsize_t> count = shape_.along_dims(high - low, 1);
        const SpaceHandle from(H5Dget_space(dataset_.get()));
        H5Sselect_hyperslab(from.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(),
                            nullptr);
        const std::vector<hsize_t> whole = shape_.along_dims(size, 1);
        const SpaceHandle to(
            H5Screate_simple(static_cast<int>(whole.size()), whole.data(), nullptr));
        const std::vector<hsize_t> first = shape_.along_dims(at, 0);
        H5Sselect_hyperslab(to.get(), H5S_SELECT_SET, first.data(), nullptr, count.data(), nullptr);
        bool lossy = false;
        const PropertyHandle transfer = exact_transfer(lossy);
        if (H5Dread(dataset_.get(), memory_type_.get(), to.get(), from.get(), transfer.get(), dst) <
            0) {
            const std::string planes = fmt::format("planes {} to {}", low.z, high.z - 1);
            if (lossy) {
                throw Error(ErrorKind::unsupported, {name_, planes},
                            "there are 64-bit integers that float64 cannot hold (beyond 2^53)");
            }
            throw Error(ErrorKind::io, {name_, planes},
                        fmt::format("cannot read: {}", hdf5_message()));
        }
    }

    /// Reads nodes [low, high) of a dataset with another axis order, through a buffer.
    void read_turned(const Int3& low, const Int3& high, const Slab& slab, std::byte* dst) {
        const Int3 size = high - low;
        const std::size_t value = size_of(type_);
        if (static_cast<std::size_t>(size.product()) * value > kTurnedBytes) {
            // Divides the box in halves along the slowest axis that can be divided.
            for (std::size_t i = 0; i < shape_.dims.size(); ++i) {
                const auto axis = std::find(shape_.axes.rbegin(), shape_.axes.rend(), i);
                const auto a = static_cast<int>(axis - shape_.axes.rbegin());
                if (axis == shape_.axes.rend() || size[a] < 2) {
                    continue;
                }
                Int3 middle = high;
                middle[a] = low[a] + size[a] / 2;
                Int3 from = low;
                from[a] = middle[a];
                read_turned(low, middle, slab, dst);
                read_turned(from, high, slab, dst);
                return;
            }
        }
        read_box(low, high, size, {0, 0, 0}, turned_.data());
        std::vector<hsize_t> strides(shape_.dims.size(), 1);
        const std::vector<hsize_t> lengths = shape_.along_dims(size, 1);
        for (std::size_t i = lengths.size() - 1; i > 0; --i) {
            strides[i - 1] = strides[i] * lengths[i];
        }
        const Int3 stride = shape_.along_axes(strides);
        for (std::int64_t z = 0; z < size.z; ++z) {
            for (std::int64_t y = 0; y < size.y; ++y) {
                const std::int64_t row =
                    ((low.z + z - slab.z0) * slab.ny + low.y + y - slab.y0) * nodes_.x + low.x;
                for (std::int64_t x = 0; x < size.x; ++x) {
                    const std::int64_t at = x * stride.x + y * stride.y + z * stride.z;
                    std::memcpy(dst + static_cast<std::size_t>(row + x) * value,
                                turned_.data() + static_cast<std::size_t>(at) * value, value);
                }
            }
        }
    }

    /// Integers of 64 bits are read unchanged.
    void take_labels(bool wanted) {
        const TypeHandle type(H5Dget_type(dataset_.get()));
        constexpr std::size_t kSize = 8;
        labels_ =
            wanted && H5Tget_class(type.get()) == H5T_INTEGER && H5Tget_size(type.get()) == kSize;
        if (labels_) {
            const bool is_signed = H5Tget_sign(type.get()) == H5T_SGN_2;
            memory_type_ = TypeHandle(H5Tcopy(is_signed ? H5T_NATIVE_INT64 : H5T_NATIVE_UINT64));
        }
    }

    /// Whether HDF5 leaves memory unchanged where nothing was written.
    [[nodiscard]] bool is_unwritten_undefined() const {
        const PropertyHandle creation(H5Dget_create_plist(dataset_.get()));
        H5D_fill_value_t fill = H5D_FILL_VALUE_UNDEFINED;
        H5D_fill_time_t time = H5D_FILL_TIME_NEVER;
        return H5Pfill_value_defined(creation.get(), &fill) < 0 ||
               H5Pget_fill_time(creation.get(), &time) < 0 || fill == H5D_FILL_VALUE_UNDEFINED ||
               time == H5D_FILL_TIME_NEVER;
    }

    /// Whole rows of chunks are read at a time, so HDF5's chunk cache only needs to hold one chunk.
    void set_chunks(const SourceOptions& options) {
        const PropertyHandle creation(H5Dget_create_plist(dataset_.get()));
        if (H5Pget_layout(creation.get()) != H5D_CHUNKED) {
            return;
        }
        std::vector<hsize_t> dims(shape_.dims.size(), 1);
        H5Pget_chunk(creation.get(), static_cast<int>(dims.size()), dims.data());
        std::uint64_t bytes = size_of(type_);
        for (const hsize_t n : dims) {
            bytes *= n;
            if (bytes > options.max_heap) {
                throw Error(ErrorKind::limit, {name_},
                            fmt::format("one chunk of [{}] values needs more than {} MiB of memory",
                                        fmt::join(dims, ", "), options.max_heap >> 20U),
                            {{RemedyKind::more_memory}, {RemedyKind::smaller_input_chunk}});
            }
        }
        const Int3 chunk = shape_.along_axes(dims);
        granularity_ = {std::min(nodes_.z, chunk.z), std::min(nodes_.y, chunk.y)};
        chunks_ = Hdf5Chunks::open(dataset_.get(), name_, shape_, dims, memory_type_.get(),
                                   options.max_heap / 3, input_);
        if (chunks_) {
            heap_ += chunks_->heap();
            return;
        }
        require_filters(creation.get());
        // The cached chunk, and the input and output of the filters.
        heap_ += 3 * bytes;
        H5Pset_chunk_cache(access_.get(), 521, std::max<std::uint64_t>(bytes, 1U << 20U), 1.0);
        dataset_.reset();
        dataset_ = open_named();
        if (!dataset_.valid()) {
            throw Error(ErrorKind::io, {name_}, fmt::format("cannot open: {}", hdf5_message()));
        }
        if (input_.is_remote()) {
            remote_chunks_ = std::make_unique<RemoteChunks>(input_, dataset_.get(), shape_, dims,
                                                            bytes + bytes / 8 + 4096);
            heap_ += 2 * bytes;
        }
    }

    void require_filters(hid_t creation) const {
        for (int i = 0; i < H5Pget_nfilters(creation); ++i) {
            unsigned flags = 0;
            unsigned configuration = 0;
            std::size_t numbers = 0;
            std::array<char, 64> name{};
            const H5Z_filter_t filter =
                H5Pget_filter2(creation, static_cast<unsigned>(i), &flags, &numbers, nullptr,
                               name.size() - 1, name.data(), &configuration);
            if (H5Zfilter_avail(filter) <= 0) {
                throw Error(
                    ErrorKind::unsupported, {name_},
                    fmt::format("the chunks use HDF5 filter {} ({}), whose plugin is not "
                                "installed; install the plugin, and set HDF5_PLUGIN_PATH to its "
                                "folder if HDF5 does not find it; or, where it is installed, "
                                "remove the filter with: h5repack -f GZIP=1 IN OUT",
                                filter, name[0] == 0 ? "unnamed" : name.data()));
            }
        }
    }

    /// Maps a dataset that is stored exactly as read() would return it, so that no copy is needed.
    /// The map is of the same file that HDF5 reads, and only used if both have the same first and
    /// last row.
    void map_contiguous() {
        const PropertyHandle creation(H5Dget_create_plist(dataset_.get()));
        const TypeHandle stored(H5Dget_type(dataset_.get()));
        const haddr_t offset = offset_of_values(dataset_.get());
        if (!shape_.at.empty() || !is_in_order() ||
            H5Pget_layout(creation.get()) != H5D_CONTIGUOUS || offset == HADDR_UNDEF ||
            H5Pget_external_count(creation.get()) != 0 ||
            H5Tequal(stored.get(), memory_type_.get()) <= 0 || offset % size_of(type_) != 0) {
            return;
        }
        const FileHandle file(H5Iget_file_id(dataset_.get()));
        const PropertyHandle access(H5Fget_access_plist(file.get()));
        void* descriptor = nullptr;
        if (H5Pget_driver(access.get()) != H5FD_SEC2 ||
            H5Fget_vfd_handle(file.get(), H5P_DEFAULT, &descriptor) < 0) {
            return;
        }
        const auto bytes = static_cast<std::uint64_t>(nodes_.product()) * size_of(type_);
        map_.emplace(*static_cast<const int*>(descriptor), file_of(dataset_.get()));
        if (map_->bytes().size() < bytes || map_->bytes().size() - bytes < offset) {
            throw Error(ErrorKind::corrupt, {name_}, "the file ends before the dataset does");
        }
        mapped_ = map_->bytes().subspan(offset, bytes);
        if (!shows_row(0, 0) || !shows_row(nodes_.z - 1, nodes_.y - 1)) {
            mapped_ = {};
            map_.reset();
        }
    }

    bool shows_row(std::int64_t z, std::int64_t y) {
        std::vector<std::byte> row(static_cast<std::size_t>(nodes_.x) * size_of(type_));
        read_by_hdf5({z, 1, y, 1}, {z, 1, y, 1}, row.data());
        const auto at = static_cast<std::size_t>(z * nodes_.y + y) * row.size();
        return std::equal(row.begin(), row.end(),
                          mapped_.begin() + static_cast<std::ptrdiff_t>(at));
    }

    InputFile input_;
    std::vector<std::filesystem::path> files_;
    FileHandle file_;
    PropertyHandle access_{H5Pcreate(H5P_DATASET_ACCESS)};
    DatasetHandle dataset_;
    std::string dataset_name_;
    std::string name_;
    DatasetShape shape_;
    Int3 nodes_{1, 1, 1};
    ValueType type_ = ValueType::f32;
    std::vector<Hdf5Axis> axes_;  ///< of the dataset
    std::optional<Hdf5Dialect> dialect_;
    std::optional<SliceScaling> slices_;
    Hdf5Place place_;
    std::optional<CfPositions> positions_;
    bool labels_ = false;    ///< the stored 64-bit integers are labels
    bool unsigned_ = false;  ///< the stored integers are signed, but mean unsigned ones
    std::vector<std::string> notes_;
    Granularity granularity_;
    bool unwritten_is_undefined_ = false;
    std::optional<Hdf5Chunks> chunks_;
    /// For a remote file: a contiguous dataset, or chunks that HDF5 has to decode.
    std::unique_ptr<VolumeSource> remote_numbers_;
    std::unique_ptr<RemoteChunks> remote_chunks_;
    static constexpr std::size_t kTurnedBytes = std::size_t{4} << 20U;
    std::vector<std::byte> turned_;  ///< a part of a dataset with another axis order
    std::optional<MappedFile> map_;
    std::span<const std::byte> mapped_;
    std::uint64_t heap_ = 2U << 20U;
    TypeHandle memory_type_;  ///< of read()'s values; little endian, like memory
};

std::unique_ptr<VolumeSource> open_hdf5_volume(const InputFile& file,
                                               const SourceOptions& options) {
    auto source = std::make_unique<Hdf5Source>(file, options);
    const Scaling scaling = source->scaling();
    const std::optional<CfPositions> at = source->positions();
    const std::vector<double> heights = at ? source->heights() : std::vector<double>{};
    const std::array<bool, 3> back = at ? std::array<bool, 3>{} : source->backward();
    UnevenCoordinates uneven = source->uneven();
    const std::optional<SliceScaling> slices = source->slices();
    const std::array<NodeRange, 3> part = source->without_padding();
    std::unique_ptr<VolumeSource> volume = std::move(source);
    if (std::any_of(part.begin(), part.end(),
                    [](const NodeRange& r) { return r.to.has_value(); })) {
        volume = cropped(std::move(volume), part, {1, 1, 1});
    }
    if (slices) {
        volume = scaled_by_slices(std::move(volume), *slices);
    }
    if (at) {
        const VolumeDescription of = volume->describe();
        std::vector<std::string> notes;
        NodePositionsPtr positions = cf_positions(
            *at, of.nodes, heights,
            [&](const std::string& dataset) {
                SourceOptions own = options;
                own.dataset = dataset;
                own.index.clear();
                own.labels = false;
                own.max_heap /= 4;  // there are three of them, beside the values
                own.spacing = {1, 1, 1};
                return open_hdf5_volume(file, own);
            },
            of.name, notes);
        volume =
            with_notes(with_positions(std::move(volume), std::move(positions)), std::move(notes));
        return scaled(std::move(volume), scaling);
    }
    volume = with_uneven_axes(mirrored(std::move(volume), back), std::move(uneven));
    return scaled(std::move(volume), scaling);
}

}  // namespace

bool is_hdf5(const InputFile& file) {
    return start_of_hdf5(file).has_value();
}

VolumeFormat hdf5_format() {
    return {
        .about = {"HDF5", ".h5 .hdf5 .nc .mat .mnc .ims .hspy .emd .cmap", ""},
        .takes = {.dataset = true, .index = true},
        .reads_urls = true,
        .recognises = [](const VolumeInput& input) { return !input.folder && is_hdf5(input.file); },
        .open = [](const VolumeInput& input,
                   const SourceOptions& options) { return open_hdf5_volume(input.file, options); }};
}

}  // namespace isonest::detail
