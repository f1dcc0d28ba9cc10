// Source: https://docs.unidata.ucar.edu/netcdf-c/current/file_format_specifications.html
#include "preprocess/sources/arrays/netcdf3_header.h"

#include <fmt/format.h>

#include <algorithm>

#include <isonest/error.h>

#include "preprocess/sources/bytes/header_words.h"
#include "preprocess/sources/bytes/input_file.h"

namespace isonest::detail {
namespace {

constexpr int kChar = 2;
/// Dimensions, variables and attributes together; each takes some hundred bytes of memory.
constexpr std::uint64_t kMaxItems = 200000;
constexpr std::uint64_t kMaxBytes = std::uint64_t{1} << 60U;

std::uint64_t padded(std::uint64_t bytes) {
    return (bytes + 3) / 4 * 4;
}

class Reader {
  public:
    explicit Reader(const std::filesystem::path& path)
        : path_(path), size_(regular_file_size(path)) {}

    NetcdfHeader read() {
        constexpr std::size_t kFirst = std::size_t{1} << 20U;
        constexpr std::size_t kMax = std::size_t{1} << 23U;
        for (const std::size_t most : {kFirst, kMax}) {
            text_ = first_bytes(path_, most);
            at_ = 4;
            items_ = 0;
            short_ = false;
            NetcdfHeader header = parse();
            if (!short_) {
                return header;
            }
            if (text_.size() == size_) {
                break;
            }
        }
        corrupt("the header is cut short, or longer than 8 MiB");
    }

  private:
    [[noreturn]] void corrupt(const std::string& what) const {
        throw Error(ErrorKind::corrupt, {path_.string(), fmt::format("byte {}", at_)}, what);
    }
    /// Zeros after the end of the text.
    std::string_view take(std::uint64_t bytes) {
        if (bytes > text_.size() - at_) {
            short_ = true;
            at_ = text_.size();
            return {};
        }
        const std::string_view part(text_.data() + at_, static_cast<std::size_t>(bytes));
        at_ += bytes;
        return part;
    }
    std::uint32_t word() {
        const std::string_view part = take(4);
        return part.empty() ? 0 : number_at<std::uint32_t>(part, 0, true);
    }
    std::uint64_t wide() {
        const std::string_view part = take(8);
        return part.empty() ? 0 : number_at<std::uint64_t>(part, 0, true);
    }
    /// Counts and sizes have 64 bits in CDF-5.
    std::uint64_t count() { return version_ == 5 ? wide() : word(); }

    std::string name() {
        const std::uint64_t length = count();
        if (length > 65536) {
            corrupt(fmt::format("a name of {} bytes is too long", length));
        }
        return std::string(take(padded(length)).substr(0, static_cast<std::size_t>(length)));
    }
    /// The number of items in a list with this tag; 0 if the list is absent.
    std::uint64_t list(std::uint32_t tag) {
        const std::uint32_t found = word();
        const std::uint64_t items = count();
        if (short_ || (found == 0 && items == 0)) {
            return 0;
        }
        if (found != tag) {
            corrupt(fmt::format("a list of {} items has tag {}, but {} is expected", items, found,
                                tag));
        }
        if (items > kMaxItems - items_) {
            corrupt(fmt::format("the header has more than {} dimensions, variables and attributes",
                                kMaxItems));
        }
        items_ += items;
        return items;
    }

    NetcdfHeader parse() {
        constexpr std::uint32_t kDims = 10;
        constexpr std::uint32_t kVariables = 11;
        if (text_.size() < 8) {
            short_ = true;
            return {};
        }
        version_ = static_cast<unsigned char>(text_[3]);
        NetcdfHeader header;
        std::uint64_t records = count();
        const std::uint64_t streaming = version_ == 5 ? ~std::uint64_t{0} : 0xFFFFFFFFU;
        std::size_t record_dim = ~std::size_t{0};
        for (std::uint64_t n = list(kDims); n > 0 && !short_; --n) {
            std::string of = name();
            const std::uint64_t length = count();
            if (length == 0) {
                record_dim = header.dims.size();
            } else if (length > (std::uint64_t{1} << 48U)) {
                corrupt(fmt::format("a dimension of length {} is too long", length));
            }
            header.dims.push_back({std::move(of), length});
        }
        attributes();
        for (std::uint64_t n = list(kVariables); n > 0 && !short_; --n) {
            header.variables.push_back(variable(header, record_dim));
        }
        if (short_) {
            return {};
        }
        find_record_bytes(header);
        if (records == streaming) {
            records = records_that_fit(header);
        }
        if (record_dim < header.dims.size()) {
            header.dims[record_dim].length = records;
        }
        return header;
    }

    std::vector<NetcdfAttribute> attributes() {
        constexpr std::uint32_t kAttributes = 12;
        constexpr std::uint64_t kMaxNumbers = 1024;
        std::vector<NetcdfAttribute> all;
        for (std::uint64_t n = list(kAttributes); n > 0 && !short_; --n) {
            NetcdfAttribute attribute;
            attribute.name = name();
            const auto type = static_cast<int>(word());
            const std::uint64_t values = count();
            const std::size_t each = netcdf_type_bytes(type);
            if (short_) {
                break;
            }
            if (each == 0 || values > (std::uint64_t{1} << 30U)) {
                corrupt(fmt::format("invalid attribute: {} numbers of type {}", values, type));
            }
            const std::string_view bytes = take(padded(values * each));
            if (type == kChar) {
                attribute.text = bytes.substr(0, static_cast<std::size_t>(values));
            } else if (values <= kMaxNumbers && !bytes.empty()) {
                for (std::size_t i = 0; i < values; ++i) {
                    attribute.numbers.push_back(netcdf_number(bytes, i * each, type));
                }
            }
            all.push_back(std::move(attribute));
        }
        return all;
    }

    NetcdfVariable variable(const NetcdfHeader& header, std::size_t record_dim) {
        constexpr std::uint64_t kMaxDims = 1024;
        NetcdfVariable v;
        v.name = name();
        const std::uint64_t dims = count();
        if (dims > kMaxDims) {
            corrupt(fmt::format("a variable has too many axes: {}", dims));
        }
        for (std::uint64_t i = 0; i < dims && !short_; ++i) {
            const std::uint64_t dim = count();
            if (dim >= header.dims.size() && !short_) {
                corrupt(
                    fmt::format("a variable refers to dimension {}, which does not exist", dim));
            }
            v.dims.push_back(static_cast<std::size_t>(dim));
        }
        v.attributes = attributes();
        v.type = static_cast<int>(word());
        count();  // its size, which is meaningless if large
        v.begin = version_ == 1 ? word() : wide();
        if (short_) {
            return v;
        }
        v.bytes = netcdf_type_bytes(v.type);
        if (v.bytes == 0) {
            corrupt(fmt::format("the variable '{:.80}' has the unknown type {}", v.name, v.type));
        }
        v.record = !v.dims.empty() && v.dims.front() == record_dim;
        for (std::size_t i = v.record ? 1 : 0; i < v.dims.size(); ++i) {
            const std::uint64_t length = header.dims[v.dims[i]].length;
            if (length == 0 || length > kMaxBytes / v.bytes) {
                corrupt(fmt::format("the variable '{:.80}' has an impossible size", v.name));
            }
            v.bytes *= length;
        }
        return v;
    }

    void find_record_bytes(NetcdfHeader& header) const {
        std::uint64_t records = 0;
        for (const NetcdfVariable& v : header.variables) {
            if (v.record) {
                ++records;
                header.record_bytes += padded(v.bytes);
                if (header.record_bytes > kMaxBytes) {
                    corrupt("the records have an impossible size");
                }
            }
        }
        // The records of a single record variable are not padded.
        for (const NetcdfVariable& v : header.variables) {
            if (v.record && records == 1) {
                header.record_bytes = v.bytes;
            }
        }
    }
    [[nodiscard]] std::uint64_t records_that_fit(const NetcdfHeader& header) const {
        std::uint64_t begin = size_;
        for (const NetcdfVariable& v : header.variables) {
            begin = v.record ? std::min(begin, v.begin) : begin;
        }
        return header.record_bytes == 0 ? 0 : (size_ - begin) / header.record_bytes;
    }

    const std::filesystem::path& path_;
    std::uint64_t size_;
    std::string text_;
    std::size_t at_ = 0;
    std::uint64_t items_ = 0;  ///< of all lists so far
    int version_ = 1;
    bool short_ = false;  ///< more text is needed
};

}  // namespace

std::size_t netcdf_type_bytes(int type) {
    switch (type) {
        case 1:
        case kChar:
        case 7:
            return 1;
        case 3:
        case 8:
            return 2;
        case 4:
        case 5:
        case 9:
            return 4;
        case 6:
        case 10:
        case 11:
            return 8;
        default:
            return 0;
    }
}

double netcdf_number(std::string_view bytes, std::size_t at, int type) {
    switch (type) {
        case 1:
            return number_at<std::int8_t>(bytes, at, true);
        case 3:
            return number_at<std::int16_t>(bytes, at, true);
        case 4:
            return number_at<std::int32_t>(bytes, at, true);
        case 5:
            return static_cast<double>(number_at<float>(bytes, at, true));
        case 6:
            return number_at<double>(bytes, at, true);
        case 7:
            return number_at<std::uint8_t>(bytes, at, true);
        case 8:
            return number_at<std::uint16_t>(bytes, at, true);
        case 9:
            return number_at<std::uint32_t>(bytes, at, true);
        case 10:
            return static_cast<double>(number_at<std::int64_t>(bytes, at, true));
        default:
            return static_cast<double>(number_at<std::uint64_t>(bytes, at, true));
    }
}

NetcdfHeader read_netcdf3_header(const std::filesystem::path& path) {
    return Reader(path).read();
}

}  // namespace isonest::detail
