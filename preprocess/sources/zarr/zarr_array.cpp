// Sources: https://zarr-specs.readthedocs.io/en/latest/v2/v2.0.html, .../v3/core/index.html
#include "preprocess/sources/zarr/zarr_array.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <numeric>

#include <isonest/error.h>

namespace isonest::detail {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxAxes = 32;

class Description {
  public:
    Description(ZarrFiles& files, const std::filesystem::path& folder) : files_(files) {
        array_.folder = folder;
    }

    ZarrArray read() {
        array_.description = array_.folder / "zarr.json";
        if (const auto v3 = files_.json(array_.description)) {
            read_v3(*v3);
        } else {
            array_.description = array_.folder / ".zarray";
            const auto v2 = files_.json(array_.description);
            if (!v2) {
                files_.refuse();
                throw Error(ErrorKind::not_found, {array_.folder.string()},
                            "there is no Zarr array in this folder");
            }
            read_v2(*v2);
        }
        check_lengths();
        return std::move(array_);
    }

  private:
    [[noreturn]] void corrupt(const std::string& what) const {
        throw Error(ErrorKind::corrupt, {array_.description.string()}, what);
    }
    [[noreturn]] void unsupported(const std::string& what) const {
        throw Error(ErrorKind::unsupported, {array_.description.string()}, what);
    }
    [[nodiscard]] Lengths lengths(const json& list, const char* what) const {
        Lengths all;
        if (!list.is_array() || list.size() > kMaxAxes) {
            corrupt(fmt::format("'{}' is not a list of up to {} lengths", what, kMaxAxes));
        }
        for (const json& length : list) {
            if (!length.is_number_unsigned() || length.get<std::uint64_t>() < 1 ||
                length.get<std::uint64_t>() > (std::uint64_t{1} << 50U)) {
                corrupt(fmt::format("'{}' has the invalid length {:.40}", what, length.dump()));
            }
            all.push_back(length.get<std::uint64_t>());
        }
        return all;
    }

    void read_v2(const json& d) {
        if (member(d, "zarr_format") != 2) {
            unsupported("only Zarr versions 2 and 3 are supported");
        }
        array_.shape = lengths(member(d, "shape"), "shape");
        array_.chunk.shape = lengths(member(d, "chunks"), "chunks");
        const json& type = member(d, "dtype");
        if (!type.is_string()) {
            unsupported(
                "the array has records of several fields; store only the field that is the volume");
        }
        const auto text = type.get<std::string>();
        array_.chunk.big_endian = text.starts_with('>');
        set_type(text.empty() ? text : text.substr(1));
        const json& filters = member(d, "filters");
        constexpr std::size_t kMaxFilters = 32;
        if (!filters.is_null() && (!filters.is_array() || filters.size() > kMaxFilters)) {
            corrupt(fmt::format("'filters' is not a list of up to {} filters", kMaxFilters));
        }
        for (const json& filter : filters.is_null() ? json::array() : filters) {
            array_.chunk.codecs.push_back(codec_of_v2(filter));
        }
        if (const json& packed = member(d, "compressor"); !packed.is_null()) {
            array_.chunk.codecs.push_back(codec_of_v2(packed));
        }
        axes_in_order(array_.chunk);
        if (member(d, "order") == "F") {
            std::reverse(array_.chunk.order.begin(), array_.chunk.order.end());
        }
        if (member(d, "dimension_separator") == "/") {
            array_.separator = '/';
        }
        set_fill(member(d, "fill_value"));
        array_.attributes = files_.json(array_.folder / ".zattrs").value_or(json::object());
        set_names(member(array_.attributes, "_ARRAY_DIMENSIONS"));
    }

    [[nodiscard]] ZarrCodec codec_of_v2(const json& d) const {
        const json& id = member(d, "id");
        return zarr_codec(id.is_string() ? id.get<std::string>() : "", d, array_.folder.string());
    }

    void read_v3(const json& d) {
        if (member(d, "zarr_format") != 3 || member(d, "node_type") != "array") {
            unsupported("not an array of Zarr version 3");
        }
        array_.shape = lengths(member(d, "shape"), "shape");
        const json& type = member(d, "data_type");
        if (!type.is_string()) {
            unsupported(fmt::format("the type {:.60} is not supported", type.dump()));
        }
        set_type(type.get<std::string>());
        const json& grid = member(d, "chunk_grid");
        if (member(grid, "name") != "regular") {
            unsupported("a chunk grid that is not regular is not supported");
        }
        const Lengths outer =
            lengths(member(member(grid, "configuration"), "chunk_shape"), "chunk_shape");
        const json& keys = member(d, "chunk_key_encoding");
        const json& separator = member(member(keys, "configuration"), "separator");
        const bool v2_keys = member(keys, "name") == "v2";
        array_.separator = separator.is_null() ? (v2_keys ? '.' : '/')
                           : separator == "."  ? '.'
                                               : '/';
        array_.prefix = v2_keys ? "" : "c";
        array_.chunk.shape = outer;
        read_codecs(member(d, "codecs"), outer, array_.chunk, true);
        if (const json& more = member(d, "storage_transformers");
            !more.is_null() && !more.empty()) {
            unsupported("storage transformers are not supported");
        }
        set_fill(member(d, "fill_value"));
        array_.attributes = member(d, "attributes");
        set_names(member(d, "dimension_names"));
    }

    static void axes_in_order(ZarrChunk& chunk) {
        chunk.order.resize(chunk.shape.size());
        std::iota(chunk.order.begin(), chunk.order.end(), std::size_t{0});
    }

    /// transpose* and filters of numbers, then bytes or sharding_indexed, then codecs from bytes to
    /// bytes.
    void read_codecs(const json& list, const Lengths& shape, ZarrChunk& chunk, bool may_shard) {
        chunk.shape = shape;
        axes_in_order(chunk);
        bool in_bytes = false;
        if (!list.is_array()) {
            corrupt("'codecs' is not a list");
        }
        for (const json& codec : list) {
            const json& id = codec.is_string() ? codec : member(codec, "name");
            const std::string name = id.is_string() ? id.get<std::string>() : "";
            const json& options = member(codec, "configuration");
            if (name == "transpose" && !in_bytes) {
                transpose(member(options, "order"), chunk);
            } else if (is_of_numbers(name) && !in_bytes) {
                chunk.codecs.push_back(zarr_codec(name, options, array_.folder.string()));
            } else if (name == "bytes" && !in_bytes) {
                chunk.big_endian = member(options, "endian") == "big";
                for (ZarrCodec& filter : chunk.codecs) {
                    filter.made.big_endian = filter.stored.big_endian = chunk.big_endian;
                }
                in_bytes = true;
            } else if (name == "sharding_indexed" && !in_bytes && may_shard &&
                       chunk.codecs.empty()) {
                shard(options, chunk);
                in_bytes = true;
            } else if (in_bytes && !array_.shard) {
                chunk.codecs.push_back(zarr_codec(name, options, array_.folder.string()));
            } else {
                unsupported(fmt::format(
                    "the codec '{:.40}' is not supported at this position in 'codecs'", name));
            }
        }
        if (!in_bytes) {
            corrupt("'codecs' has no codec that converts numbers to bytes");
        }
    }

    void transpose(const json& order, ZarrChunk& chunk) const {
        std::vector<std::size_t> axes;
        for (const json& axis : order.is_array() ? order : json::array()) {
            axes.push_back(axis.is_number_unsigned() ? axis.get<std::size_t>() : kMaxAxes);
        }
        std::vector<std::size_t> sorted = axes;
        std::sort(sorted.begin(), sorted.end());
        std::vector<std::size_t> all(chunk.shape.size());
        std::iota(all.begin(), all.end(), std::size_t{0});
        if (sorted != all) {
            unsupported(fmt::format("the transpose order {:.60} is not supported", order.dump()));
        }
        std::vector<std::size_t> made;
        for (const std::size_t axis : axes) {
            made.push_back(chunk.order[axis]);
        }
        chunk.order = made;
    }

    void shard(const json& options, ZarrChunk& chunk) {
        for (std::size_t i = 0; i < chunk.order.size(); ++i) {
            if (chunk.order[i] != i) {
                unsupported("transposed shards are not supported");
            }
        }
        ZarrArray::Shard s;
        s.shape = chunk.shape;
        const Lengths inner = lengths(member(options, "chunk_shape"), "chunk_shape");
        if (inner.size() != s.shape.size()) {
            corrupt("the chunks of a shard do not have as many axes as the shard");
        }
        for (std::size_t i = 0; i < inner.size(); ++i) {
            if (s.shape[i] % inner[i] != 0) {
                corrupt("the size of a shard is not a multiple of the size of its chunks");
            }
        }
        s.index_at_end = member(options, "index_location") != "start";
        ZarrChunk index;
        read_codecs(member(options, "index_codecs"), s.shape, index, false);
        if (index.big_endian ||
            std::any_of(index.codecs.begin(), index.codecs.end(),
                        [](const ZarrCodec& c) { return c.kind != ZarrCodec::Kind::crc32c; })) {
            unsupported("a compressed or big-endian shard index is not supported");
        }
        s.index_codecs = index.codecs;
        read_codecs(member(options, "codecs"), inner, chunk, false);
        array_.shard = s;
    }

    void set_type(const std::string& text) {
        static const std::map<std::string, ValueType> types{
            {"u1", ValueType::u8},       {"i1", ValueType::i8},       {"u2", ValueType::u16},
            {"i2", ValueType::i16},      {"u4", ValueType::u32},      {"i4", ValueType::i32},
            {"f4", ValueType::f32},      {"f8", ValueType::f64},      {"b1", ValueType::u8},
            {"uint8", ValueType::u8},    {"int8", ValueType::i8},     {"uint16", ValueType::u16},
            {"int16", ValueType::i16},   {"uint32", ValueType::u32},  {"int32", ValueType::i32},
            {"float32", ValueType::f32}, {"float64", ValueType::f64}, {"bool", ValueType::u8}};
        static const std::map<std::string, StoredNumber> others{
            {"f2", StoredNumber::f16},    {"i8", StoredNumber::i64},
            {"u8", StoredNumber::u64},    {"float16", StoredNumber::f16},
            {"int64", StoredNumber::i64}, {"uint64", StoredNumber::u64}};
        if (const auto it = types.find(text); it != types.end()) {
            array_.type = it->second;
        } else if (const auto other = others.find(text); other != others.end()) {
            array_.stored = other->second;
        } else {
            unsupported(
                fmt::format("the type '{:.40}' is not supported; store integers or floating point "
                            "numbers of up to 64 bits",
                            text));
        }
    }

    void set_fill(const json& given) {
        array_.fill.assign(array_.value_bytes(), std::byte{0});
        if (given.is_null()) {
            return;
        }
        array_.has_fill = true;
        double number = 0;
        if (given.is_boolean()) {
            number = given.get<bool>() ? 1 : 0;
        } else if (given.is_number()) {
            number = given.get<double>();
        } else if (given == "NaN") {
            number = std::numeric_limits<double>::quiet_NaN();
        } else if (given == "Infinity" || given == "-Infinity") {
            number = given == "Infinity" ? HUGE_VAL : -HUGE_VAL;
        } else if (given.is_string() && given.get<std::string>().starts_with("0x")) {
            return set_fill_bits(given.get<std::string>());
        } else {
            unsupported(fmt::format("the fill value {:.60} is not supported", given.dump()));
        }
        array_.fill_number = number;
        if (array_.stored == StoredNumber::i64 || array_.stored == StoredNumber::u64) {
            if (given.is_number_unsigned()) {
                return put(given.get<std::uint64_t>());
            }
            if (given.is_number_integer()) {
                return put(given.get<std::int64_t>());
            }
        } else if (array_.stored == StoredNumber::f16) {
            return put(half_of(number));
        } else {
            const bool fits = dispatch(array_.type, [&](auto tag) {
                using T = typename decltype(tag)::type;
                if constexpr (std::is_integral_v<T>) {
                    if (!(number >= static_cast<double>(std::numeric_limits<T>::min()) &&
                          number <= static_cast<double>(std::numeric_limits<T>::max()) &&
                          number == std::floor(number))) {
                        return false;
                    }
                }
                put(static_cast<T>(number));
                return true;
            });
            if (fits) {
                return;
            }
        }
        unsupported(fmt::format("the fill value {:.60} is not supported for numbers of this type",
                                given.dump()));
    }
    /// "0x7fc00000": the bits.
    void set_fill_bits(const std::string& text) {
        std::uint64_t bits = 0;
        const auto [end, error] =
            std::from_chars(text.data() + 2, text.data() + text.size(), bits, 16);
        if (error != std::errc{} || end != text.data() + text.size()) {
            corrupt(fmt::format("the fill value '{:.40}' is not a hexadecimal number", text));
        }
        std::memcpy(array_.fill.data(), &bits, array_.fill.size());
        array_.fill_number = std::numeric_limits<double>::quiet_NaN();
    }
    template <class T>
    void put(T value) {
        std::memcpy(array_.fill.data(), &value, std::min(sizeof(T), array_.fill.size()));
    }

    void set_names(const json& list) {
        if (!list.is_array() || list.size() != array_.shape.size()) {
            return;
        }
        for (const json& name : list) {
            array_.names.push_back(name.is_string() ? name.get<std::string>() : "");
        }
    }

    void check_lengths() const {
        if (array_.shape.empty() || array_.chunk.shape.size() != array_.shape.size()) {
            corrupt("the array and its chunks must have the same number of axes, at least one");
        }
        constexpr std::uint64_t kMax = std::uint64_t{1} << 40U;
        for (const Lengths* const lengths :
             {&array_.chunk.shape, array_.shard ? &array_.shard->shape : &array_.chunk.shape}) {
            std::uint64_t values = array_.value_bytes();
            for (const std::uint64_t length : *lengths) {
                if (length > kMax / values) {
                    corrupt("a chunk has more than 2^40 bytes");
                }
                values *= length;
            }
        }
    }

    ZarrFiles& files_;
    ZarrArray array_;
};

}  // namespace

std::filesystem::path ZarrArray::file_of(const Lengths& index) const {
    std::string name = prefix;
    for (const std::uint64_t i : index) {
        name += fmt::format("{}{}", name.empty() ? "" : std::string(1, separator), i);
    }
    return folder / name;
}

std::filesystem::path description_of(ZarrFiles& files, const std::filesystem::path& folder) {
    std::filesystem::path v3 = folder / "zarr.json";
    return files.has(v3) ? v3 : folder / ".zarray";
}

bool is_zarr_array(ZarrFiles& files, const std::filesystem::path& folder) {
    if (files.has(folder / ".zarray")) {
        return true;
    }
    const auto v3 = files.json(folder / "zarr.json");
    return v3 && v3->is_object() && v3->value("node_type", json()) == "array";
}

bool is_zarr_group(ZarrFiles& files, const std::filesystem::path& folder) {
    if (files.has(folder / ".zgroup")) {
        return true;
    }
    const auto v3 = files.json(folder / "zarr.json");
    return v3 && v3->is_object() && v3->value("node_type", json()) == "group";
}

json zarr_group_attributes(ZarrFiles& files, const std::filesystem::path& folder) {
    if (const auto v3 = files.json(folder / "zarr.json"); v3 && v3->is_object()) {
        return v3->value("attributes", json::object());
    }
    return files.json(folder / ".zattrs").value_or(json::object());
}

ZarrArray read_zarr_array(ZarrFiles& files, const std::filesystem::path& folder) {
    return Description(files, folder).read();
}

}  // namespace isonest::detail
