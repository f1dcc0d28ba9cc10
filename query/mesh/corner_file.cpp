#include "query/mesh/corner_file.h"

#include <algorithm>

namespace isonest::detail {

void CornerFile::begin(std::uint64_t vertices) {
    is_narrow_ = bits_ == Bits::as_needed && vertices < kNoNarrow;
}

void CornerFile::write(std::uint64_t first, std::span<const ElementCorners> corners) {
    if (!is_narrow_) {
        file_.write_at(first * sizeof(ElementCorners), std::as_bytes(corners));
        return;
    }
    std::array<CornerView::Narrow, 1024> some;
    while (!corners.empty()) {
        const std::size_t count = std::min(some.size(), corners.size());
        std::transform(corners.begin(), corners.begin() + static_cast<std::ptrdiff_t>(count),
                       some.begin(), [](const ElementCorners& c) {
                           return CornerView::Narrow{static_cast<std::uint32_t>(c[0]),
                                                     static_cast<std::uint32_t>(c[1]),
                                                     static_cast<std::uint32_t>(c[2])};
                       });
        file_.write_at(first * sizeof(CornerView::Narrow),
                       std::as_bytes(std::span(some).first(count)));
        first += count;
        corners = corners.subspan(count);
    }
}

void CornerFile::map(std::uint64_t elements) {
    elements_ = elements;
    file_.map(elements * row_bytes());
}

}  // namespace isonest::detail
