#include <algorithm>
#include <string_view>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/volume_format.h"

#if ISONEST_WITH_TIFF

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include <isonest/error.h>

#include "preprocess/sources/bytes/input_file.h"
#include "preprocess/sources/numbers/raw_source.h"
#include "preprocess/sources/placement/placement.h"
#include "preprocess/sources/tiff/tiff_axes.h"
#include "preprocess/sources/tiff/tiff_pages.h"
#include "preprocess/sources/wrapping/label_names.h"

namespace isonest::detail {
namespace {

/// A volume of pages: plane z is page first + z * step, or the one that `order` has at that index.
struct PagePlace {
    Int3 nodes;
    std::vector<std::int64_t> order;
    std::int64_t first = 0;
    std::int64_t step = 1;
    std::int64_t sample = 0;
    std::int64_t sample_step = 0;  ///< from one plane to the next
    bool is_stack = true;          ///< the planes are slices, or there is only one
    std::vector<std::string> notes = {};
};

class TiffSource : public VolumeSource {
  public:
    TiffSource(std::unique_ptr<TiffPages> pages, PagePlace place, const Double3& spacing,
               std::optional<LengthUnit> unit, std::string name)
        : pages_(std::move(pages)),
          place_(std::move(place)),
          spacing_(spacing),
          unit_(unit),
          name_(std::move(name)) {}
    [[nodiscard]] VolumeDescription describe() const override {
        const TiffPage& page = pages_->page();
        return {place_.nodes, page.stored ? bits_type(*page.stored) : page.type,
                spacing_,     {0, 0, 0},
                name_,        kAlongWorld,
                false,        unit_};
    }
    [[nodiscard]] std::vector<std::filesystem::path> files() const override {
        return pages_->files();
    }
    [[nodiscard]] std::string identity() const override {
        return fmt::format("{}pages {} {} sample {}{}\n", identity_of(files()), place_.first,
                           place_.step, place_.sample, place_.sample_step > 0 ? " on" : "");
    }
    [[nodiscard]] Granularity granularity() const override { return {1, pages_->rows()}; }
    [[nodiscard]] std::uint64_t heap() const override { return (1U << 20U) + pages_->heap(); }
    void read(std::int64_t z0, std::int64_t nz, std::int64_t y0, std::int64_t ny,
              std::byte* dst) override {
        const std::size_t row = static_cast<std::size_t>(place_.nodes.x) * size_of(describe().type);
        for (std::int64_t z = z0; z < z0 + nz; ++z) {
            const std::int64_t at = place_.first + z * place_.step;
            const std::int64_t page =
                place_.order.empty() ? at : place_.order[static_cast<std::size_t>(at)];
            const std::int64_t sample = place_.sample + z * place_.sample_step;
            for (std::int64_t y = y0; y < y0 + ny; ++y, dst += row) {
                pages_->read_row(page, y, sample, dst);
            }
        }
    }

  private:
    std::unique_ptr<TiffPages> pages_;
    PagePlace place_;
    Double3 spacing_;
    std::optional<LengthUnit> unit_;
    std::string name_;
};

PagePlace place_of(const std::vector<ArrayAxis>& page_axes, const TiffPage& page,
                   const SourceOptions& options, const std::string& name) {
    std::vector<ArrayAxis> axes = page_axes;
    axes.push_back({"y", page.height});
    axes.push_back({"x", page.width});
    const bool has_channels = std::any_of(page_axes.begin(), page_axes.end(),
                                          [](const ArrayAxis& a) { return a.name == "c"; });
    if (page.samples > 1) {
        axes.push_back({has_channels ? "sample" : "c", page.samples, false});
    }
    ChosenAxes chosen = choose_axes(axes, options.index, name);
    const std::size_t y = page_axes.size();
    // x and y are axes of the pages; z is one of the others.
    std::optional<std::size_t> z;
    bool whole = true;
    for (const auto& axis : chosen.axis) {
        if (axis && *axis != y && *axis != y + 1) {
            whole = whole && !z;
            z = axis;
        }
    }
    for (const std::size_t i : {y, y + 1}) {
        const bool is_axis =
            std::find(chosen.axis.begin(), chosen.axis.end(), i) != chosen.axis.end();
        // Axes of length 1 may have been dropped.
        whole = whole && (is_axis || axes[i].length == 1);
    }
    if (!whole) {
        throw Error(
            ErrorKind::unsupported, {name},
            "an index can only choose pages and samples; to read a part of them, crop the volume",
            {{RemedyKind::choose_index}});
    }
    PagePlace place;
    place.nodes = {page.width, page.height, z ? axes[*z].length : 1};
    std::int64_t stride = 1;
    for (std::size_t i = y; i-- > 0;) {
        place.first += chosen.at[i] * stride;
        if (z == i) {
            place.step = stride;
        }
        stride *= axes[i].length;
    }
    place.sample = page.samples > 1 ? chosen.at.back() : 0;
    if (z && *z > y + 1) {
        place.step = 0;
        place.sample_step = 1;
    }
    place.is_stack = !z || axes[*z].name == "z";
    chosen.no_space = {false, false, z && !axes[*z].of_volume && axes[*z].length > 1};
    chosen.axis[2] = z;
    place.notes = notes_of(chosen, axes, Double3{1, 1, 1});
    return place;
}

/// Values of a page; 0 if that is more than a file can have.
std::int64_t values_of(const TiffPage& page) {
    constexpr std::int64_t kMax = std::int64_t{1} << 60U;
    const std::int64_t row = page.width * page.samples;
    return page.height > kMax / row ? 0 : page.height * row;
}

/// For images that are stored after the first page's numbers.
std::unique_ptr<VolumeSource> open_images(const TiffPages& pages, const PagePlace& place,
                                          const Double3& spacing, std::optional<LengthUnit> unit,
                                          const std::string& name) {
    RawLayout layout;
    layout.nodes = place.nodes;
    layout.type = pages.page().stored ? bits_type(*pages.page().stored) : pages.page().type;
    layout.big_endian = pages.plain()->big_endian;
    layout.packing = Packing::plain;
    layout.offset = pages.plain()->offset;
    layout.exact_length = false;
    layout.spacing = spacing;
    layout.unit = unit;
    const std::int64_t pixel = pages.page().samples;
    const std::int64_t row = place.nodes.x * pixel;
    const std::int64_t plane = place.nodes.y * row;
    layout.first = static_cast<std::uint64_t>(place.first * plane + place.sample);
    layout.strides = Int3{pixel, row, place.sample_step > 0 ? 1 : place.step * plane};
    layout.whole =
        static_cast<std::uint64_t>((place.first + (place.nodes.z - 1) * place.step + 1) * plane);
    return open_raw(pages.files().front(), name, layout);
}

std::unique_ptr<VolumeSource> open_tiff(const VolumeInput& input, const SourceOptions& options) {
    std::vector<std::filesystem::path> files = input.slices({".tif", ".tiff"});
    const std::string name = input.name_of_slices(files);
    auto pages = std::make_unique<TiffPages>(std::move(files), options.max_heap);
    const TiffPage& page = pages->page();
    const bool is_stack = pages->planes_of_stack() > 1;
    const std::int64_t images = is_stack
                                    ? pages->planes_of_stack()
                                    : images_of_description(pages->description(), values_of(page));
    const bool one_page = pages->count() == 1 && images > 1;
    const bool contiguous = one_page && pages->plain().has_value();
    if (one_page && !contiguous && (is_stack || pages->description().starts_with('{'))) {
        throw Error(ErrorKind::unsupported, {name},
                    fmt::format("one page holds {} images in tiles or compressed; write each image "
                                "to a separate page",
                                images));
    }
    TiffSet set;
    set.pages = contiguous ? images : pages->count();
    set.width = page.width;
    set.height = page.height;
    set.samples = page.samples;
    set.name = name;
    for (const std::filesystem::path& file : pages->files()) {
        set.files.push_back(file.filename().string());
    }
    set.page_of = [&pages](std::size_t file, std::int64_t directory) {
        return pages->page_of(file, directory);
    };
    TiffAxes axes = axes_of_description(pages->description(), set);
    PagePlace place = place_of(axes.pages, pages->page(), options, name);
    place.order = std::move(axes.order);
    Double3 spacing{1, 1, 1};
    std::array<bool, 3> said{};
    if (axes.spacing) {
        const std::array<double, 2> resolution{pages->x_resolution(), pages->y_resolution()};
        for (std::size_t a = 0; a < (place.is_stack ? 3 : 2); ++a) {
            said.at(a) = axes.said.at(a);
            if (axes.spacing->at(a) > 0) {
                spacing.at(a) = axes.spacing->at(a);
            } else if (resolution.at(a) > 0 && std::isfinite(resolution.at(a))) {
                spacing.at(a) = 1 / resolution.at(a);
            } else {
                said.at(a) = false;
            }
            spacing.at(a) = axes.unit.converted(a, spacing.at(a));
        }
    }
    std::vector<std::string> notes = pages->notes();
    notes.insert(notes.end(), place.notes.begin(), place.notes.end());
    notes.insert(notes.end(), axes.unit.notes.begin(), axes.unit.notes.end());
    // For a z that is not a direction in space, another note says so already.
    said.at(2) = said.at(2) || !place.is_stack;
    const std::vector<std::string> unsaid = note_of_spacing(said, place.nodes, options);
    notes.insert(notes.end(), unsaid.begin(), unsaid.end());
    const std::optional<StoredNumber> stored = pages->page().stored;
    std::unique_ptr<VolumeSource> source;
    if (contiguous) {
        source = open_images(*pages, place, spacing, axes.unit.unit, name);
    } else {
        source =
            std::make_unique<TiffSource>(std::move(pages), place, spacing, axes.unit.unit, name);
    }
    source = with_notes(std::move(source), std::move(notes));
    return stored ? converted(std::move(source), *stored) : std::move(source);
}

}  // namespace
}  // namespace isonest::detail

#endif

namespace isonest::detail {
namespace {

bool is_tiff(const VolumeInput& input) {
    if (input.folder) {
        return !files_in(input.path(), {".tif", ".tiff"}).empty();
    }
    using namespace std::string_view_literals;
    return input.head.starts_with("II*\0"sv) || input.head.starts_with("MM\0*"sv) ||
           input.head.starts_with("II+\0"sv) || input.head.starts_with("MM\0+"sv);
}

}  // namespace

VolumeFormat tiff_format() {
    return {
        .about = {"TIFF", ".tif .tiff, a folder or a list of them", "libtiff-dev"},
        .takes = {.index = true}, .several_files = true, .recognises = is_tiff,
#if ISONEST_WITH_TIFF
        .open = open_tiff
#else
        .open = nullptr
#endif
    };
}

}  // namespace isonest::detail
