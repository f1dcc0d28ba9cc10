#include "preprocess/sources/tiff/ome_xml.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <utility>

#include <isonest/error.h>

namespace isonest::detail {
namespace {

constexpr std::string_view kXmlBlanks = " \t\r\n";

/// In UTF-8; nothing for what is no character.
std::string utf8(std::uint32_t code) {
    constexpr std::uint32_t kMost = 0x10FFFF;
    const auto tail = [&](unsigned shift) {
        return static_cast<char>(0x80U | ((code >> shift) & 0x3FU));
    };
    if (code < 0x80) {
        return {static_cast<char>(code)};
    }
    if (code < 0x800) {
        return {static_cast<char>(0xC0U | code >> 6U), tail(0)};
    }
    if (code < 0x10000) {
        return {static_cast<char>(0xE0U | code >> 12U), tail(6), tail(0)};
    }
    return code > kMost
               ? std::string()
               : std::string{static_cast<char>(0xF0U | code >> 18U), tail(12), tail(6), tail(0)};
}

/// What "&name;" stands for; nothing if that is not known.
std::string referenced(std::string_view name) {
    constexpr std::array<std::pair<std::string_view, std::string_view>, 5> kNamed{
        {{"lt", "<"}, {"gt", ">"}, {"amp", "&"}, {"quot", "\""}, {"apos", "'"}}};
    for (const auto& [known, character] : kNamed) {
        if (name == known) {
            return std::string(character);
        }
    }
    if (!name.starts_with('#')) {
        return {};
    }
    const bool is_hex = name.starts_with("#x");
    name.remove_prefix(is_hex ? 2 : 1);
    std::uint32_t code = 0;
    const auto [end, error] =
        std::from_chars(name.data(), name.data() + name.size(), code, is_hex ? 16 : 10);
    return error == std::errc{} && end == name.data() + name.size() ? utf8(code) : std::string();
}

std::string resolved(std::string_view value) {
    std::string out;
    while (!value.empty()) {
        const std::size_t from = std::min(value.find('&'), value.size());
        out += value.substr(0, from);
        value.remove_prefix(from);
        const std::size_t end = value.find(';');
        const std::string character = value.empty() || end == std::string_view::npos
                                          ? std::string()
                                          : referenced(value.substr(1, end - 1));
        if (!character.empty()) {
            out += character;
            value.remove_prefix(end + 1);
        } else if (!value.empty()) {
            out += '&';
            value.remove_prefix(1);
        }
    }
    return out;
}

class Elements {
  public:
    Elements(std::string_view text, const std::string& name) : text_(text), name_(name) {}

    std::vector<XmlElement> all() {
        std::vector<XmlElement> elements;
        int depth = 0;
        for (at_ = text_.find('<'); at_ != std::string_view::npos; at_ = text_.find('<', at_)) {
            if (skip("<!--", "-->") || skip("<![CDATA[", "]]>") || skip("<?", "?>") ||
                skip("<!", ">")) {
                continue;
            }
            if (skip("</", ">")) {
                --depth;
                continue;
            }
            ++at_;
            XmlElement element;
            element.depth = depth;
            const bool is_closed = read(element);
            depth += is_closed ? 0 : 1;
            if (!is_closed) {
                element.text =
                    text_.substr(at_, std::min(text_.find('<', at_), text_.size()) - at_);
            }
            elements.push_back(std::move(element));
        }
        return elements;
    }

  private:
    [[noreturn]] void has_no_end(std::size_t from) const {
        throw Error(ErrorKind::corrupt, {name_, "OME-XML"},
                    fmt::format("the tag at byte {} has no end", from));
    }
    bool skip(std::string_view begin, std::string_view end) {
        if (!text_.substr(at_).starts_with(begin)) {
            return false;
        }
        const std::size_t found = text_.find(end, at_ + begin.size());
        if (found == std::string_view::npos) {
            has_no_end(at_);
        }
        at_ = found + end.size();
        return true;
    }
    /// Up to one of the characters.
    std::string_view until(std::string_view characters) {
        const std::size_t from = at_;
        at_ = text_.find_first_of(characters, at_);
        if (at_ == std::string_view::npos) {
            has_no_end(from);
        }
        return text_.substr(from, at_ - from);
    }
    void skip_blanks() { at_ = std::min(text_.find_first_not_of(kXmlBlanks, at_), text_.size()); }
    /// Behind the "<", to behind the ">"; whether the element ends there.
    bool read(XmlElement& element) {
        const std::size_t from = at_;
        const std::string_view whole = until(" \t\r\n/>");
        element.name = whole.substr(whole.find(':') + 1);
        for (;;) {
            skip_blanks();
            const std::string_view rest = text_.substr(at_);
            if (rest.empty()) {
                has_no_end(from);
            }
            if (rest.starts_with('>') || rest.starts_with("/>")) {
                const bool is_closed = rest.front() == '/';
                at_ += is_closed ? 2 : 1;
                return is_closed;
            }
            const std::string_view key = until(" \t\r\n=>");
            skip_blanks();
            if (key.empty() || at_ >= text_.size() || text_[at_] != '=') {
                has_no_end(from);
            }
            ++at_;
            skip_blanks();
            if (at_ >= text_.size() || (text_[at_] != '"' && text_[at_] != '\'')) {
                has_no_end(from);
            }
            const std::string_view mark = text_.substr(at_, 1);
            ++at_;
            element.attributes.emplace(key, resolved(until(mark)));
            ++at_;
        }
    }

    std::string_view text_;
    const std::string& name_;
    std::size_t at_ = 0;
};

}  // namespace

std::string XmlElement::attribute(const std::string& key) const {
    const auto found = attributes.find(key);
    return found == attributes.end() ? std::string() : found->second;
}

std::vector<XmlElement> xml_elements(std::string_view text, const std::string& name) {
    return Elements(text, name).all();
}

}  // namespace isonest::detail
