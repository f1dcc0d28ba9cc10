#include "preprocess/sources/dicom/dicom_csa.h"

#include <charconv>
#include <cmath>
#include <string>
#include <vector>

#include "preprocess/sources/bytes/header_number.h"
#include "preprocess/sources/label_names/found_labels.h"

namespace isonest::detail {
namespace {

constexpr std::uint32_t kMostOfEach = 1000;  ///< tags, and items of a tag; nibabel's limit
constexpr std::size_t kTagBytes = 84;
constexpr std::size_t kItemBytes = 16;

/// Walks over the bytes; false once they end too soon.
class CsaReader {
  public:
    explicit CsaReader(std::string_view bytes) : bytes_(bytes) {}
    bool skip(std::size_t count) {
        if (count > bytes_.size() - at_) {
            return false;
        }
        at_ += count;
        return true;
    }
    /// The next `count` bytes; empty optional where there are fewer.
    std::optional<std::string_view> take(std::size_t count) {
        const std::size_t from = at_;
        return skip(count) ? std::optional(bytes_.substr(from, count)) : std::nullopt;
    }

  private:
    std::string_view bytes_;
    std::size_t at_ = 0;
};

std::string_view until_zero(std::string_view text) {
    return text.substr(0, text.find('\0'));
}

std::optional<double> number_of(std::string_view text) {
    const std::string plain = trimmed(std::string(text));
    double value = 0;
    const auto [end, error] = std::from_chars(plain.data(), plain.data() + plain.size(), value);
    return error == std::errc{} && end == plain.data() + plain.size() && std::isfinite(value)
               ? std::optional(value)
               : std::nullopt;
}

/// The items of a tag that are not empty. `first_items`: the number of items of the first tag, by
/// which lengths are too large in the older form (CSA1). False where the bytes end too soon.
bool read_items(CsaReader& reader, std::int32_t count, bool newer, std::int32_t first_items,
                std::vector<std::string_view>& items) {
    for (std::int32_t i = 0; i < count; ++i) {
        const auto head = reader.take(kItemBytes);
        if (!head) {
            return false;
        }
        const std::int64_t length =
            newer ? number_at<std::int32_t>(*head, 4, false)
                  : std::int64_t{number_at<std::int32_t>(*head, 0, false)} - first_items;
        const auto value =
            length < 0 ? std::nullopt : reader.take(static_cast<std::size_t>(length));
        if (!value) {
            return !newer;
        }
        reader.skip(static_cast<std::size_t>((4 - length % 4) % 4));
        if (!until_zero(*value).empty()) {
            items.push_back(until_zero(*value));
        }
    }
    return true;
}

}  // namespace

std::optional<SiemensMosaic> mosaic_of_csa(std::string_view csa) {
    CsaReader reader(csa);
    const bool newer = csa.starts_with("SV10");
    if (newer) {
        reader.skip(8);
    }
    const auto head = reader.take(8);
    const std::uint32_t tags = head ? number_at<std::uint32_t>(*head, 0, false) : 0;
    if (tags == 0 || tags > kMostOfEach) {
        return std::nullopt;
    }
    SiemensMosaic mosaic;
    std::int32_t first_items = 0;
    for (std::uint32_t tag = 0; tag < tags; ++tag) {
        const auto about = reader.take(kTagBytes);
        if (!about) {
            return std::nullopt;
        }
        const std::string_view name = until_zero(about->substr(0, 64));
        const auto count = number_at<std::int32_t>(*about, 76, false);
        first_items = tag == 0 ? count : first_items;
        std::vector<std::string_view> items;
        if (count < 0 || count > static_cast<std::int32_t>(kMostOfEach) ||
            !read_items(reader, count, newer, first_items, items)) {
            return std::nullopt;
        }
        if (name == "NumberOfImagesInMosaic" && !items.empty()) {
            const std::optional<double> images = number_of(items[0]);
            mosaic.images =
                images && std::fabs(*images) < 1e6 ? static_cast<std::int64_t>(*images) : 0;
        } else if (name == "SliceNormalVector" && items.size() == 3) {
            const auto x = number_of(items[0]);
            const auto y = number_of(items[1]);
            const auto z = number_of(items[2]);
            if (x && y && z) {
                mosaic.normal = Double3{*x, *y, *z};
            }
        }
    }
    return mosaic.images > 0 ? std::optional(mosaic) : std::nullopt;
}

}  // namespace isonest::detail
