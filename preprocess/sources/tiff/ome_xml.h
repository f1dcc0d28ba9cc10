// The elements of an OME-XML text, as far as they tell of pages.
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace isonest::detail {

/// The start of an element.
struct XmlElement {
    std::string name;                               ///< without the prefix of its namespace
    int depth = 0;                                  ///< of the outermost one: 0
    std::map<std::string, std::string> attributes;  ///< references to characters are resolved
    std::string text;                               ///< from its start to the next tag, as it is
    /// Empty if there is none.
    [[nodiscard]] std::string attribute(const std::string& key) const;
};

/// All elements in the order of the text; comments, instructions and CDATA sections are left out.
/// `name` is used in messages. Throws Error{corrupt} where a tag has no end. No I/O.
/// Source: https://www.w3.org/TR/xml/
std::vector<XmlElement> xml_elements(std::string_view text, const std::string& name);

}  // namespace isonest::detail
