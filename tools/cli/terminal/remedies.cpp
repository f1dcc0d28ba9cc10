#include "tools/cli/terminal/remedies.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <string_view>
#include <vector>

namespace isonest::detail::cli {
namespace {

enum class Say : std::uint8_t {
    as_is,
    bytes,    ///< "48M"
    options,  ///< "dims,type": "--dims and --type"
    forms,    ///< "dims,type": "--dims X,Y[,Z] and --type T"
    list      ///< joined without spaces
};

struct Phrase {
    const char* name;
    const char* option;    ///< that the command must have for `with` to apply; empty: none
    const char* with;      ///< {} is replaced by the value
    const char* bare;      ///< replaces `with` if there is no value; empty: `with` is used
    const char* without;   ///< if the command does not have the option
    Say say = Say::as_is;  ///< format of the value
};

/// A switch, so that the compiler warns about a kind without a phrase.
Phrase phrase_of(RemedyKind kind) {
    switch (kind) {
        case RemedyKind::replace_existing:
            return {"replace_existing", "--force", "give --force to replace it", "",
                    "delete it first"};
        case RemedyKind::choose_dataset:
            return {"choose_dataset", "--dataset", "choose one with --dataset", "", "choose one"};
        case RemedyKind::describe_numbers:
            return {"describe_numbers", "--dims", "give {}", "", "describe them", Say::forms};
        case RemedyKind::place_in_world:
            return {
                "place_in_world", "--spacing", "give {}", "", "preprocess the volume again with {}",
                Say::options};
        case RemedyKind::more_memory:
            return {"more_memory",
                    "--memory",
                    "give at least --memory {}",
                    "give more --memory",
                    "use a machine with more memory",
                    Say::bytes};
        case RemedyKind::smaller_chunk:
            return {"smaller_chunk", "--chunk", "give a smaller --chunk", "",
                    "preprocess the volume again with a smaller --chunk"};
        case RemedyKind::fewer_threads:
            return {"fewer_threads", "--threads", "give --threads {}", "give fewer --threads",
                    "use fewer threads"};
        case RemedyKind::resume:
            return {"resume", "--resume", "run again with --resume to continue", "", "run again"};
        case RemedyKind::no_resume:
            return {"no_resume", "--resume", "leave out --resume (and start from the beginning)",
                    "", "start anew"};
        case RemedyKind::make_fields:
            return {"make_fields", "", "preprocess the volume again with --indicators {}", "", "",
                    Say::list};
        case RemedyKind::other_field:
            return {"other_field", "", "name another field: {}", "name another field", ""};
        case RemedyKind::larger_error:
            return {"larger_error", "--error", "allow a larger --error", "",
                    "allow a larger error"};
        case RemedyKind::smaller_box:
            return {"smaller_box", "--box", "extract a part of it with --box", "",
                    "crop the volume"};
        case RemedyKind::other_format:
            return {"other_format", "", "write {}", "write another format", ""};
        case RemedyKind::state_missing:
            return {"state_missing", "--missing", "give the same --missing as for preprocess", "",
                    "say which value means missing data"};
        case RemedyKind::newer_version:
            return {"newer_version", "", "use a newer isonest", "", ""};
        case RemedyKind::correct_numbers:
            return {"correct_numbers",
                    "--dims",
                    "check {}",
                    "",
                    "check the size and type of the numbers",
                    Say::options};
        case RemedyKind::leave_out:
            return {"leave_out", "", "leave out {}", "", "", Say::options};
        case RemedyKind::other_name:
            return {"other_name", "", "give another name", "", ""};
        case RemedyKind::free_space:
            return {"free_space", "", "free some space or choose another output folder", "", ""};
        case RemedyKind::good_copy:
            return {"good_copy", "", "restore the file from a good copy", "", ""};
        case RemedyKind::make_store:
            return {"make_store", "", "make one with: isonest preprocess INPUT -o STORE", "", ""};
        case RemedyKind::preprocess_again:
            return {"preprocess_again", "", "preprocess the volume again", "", ""};
        case RemedyKind::smaller_input_chunk:
            return {"smaller_input_chunk", "", "store the input in smaller chunks", "", ""};
        case RemedyKind::raise_limit:
            return {"raise_limit", "", "raise the limit ({})", "raise the limit", ""};
        case RemedyKind::same_options:
            return {"same_options", "", "give those", "", ""};
        case RemedyKind::remove_leftover:
            return {"remove_leftover", "", "delete it, which discards the work of that run", "",
                    ""};
        case RemedyKind::smaller_picture:
            return {"smaller_picture", "--size", "give a smaller --size", "",
                    "draw a smaller picture"};
        case RemedyKind::less_memory:
            return {"less_memory", "--memory", "give a smaller --memory", "",
                    "close other programs"};
        case RemedyKind::other_scale:
            return {"other_scale", "--scale", "give another --scale", "", "give another scale"};
        case RemedyKind::scale_values:
            return {"scale_values", "", "scale the data before preprocessing", "", ""};
        case RemedyKind::graph:
            return {"graph", "", "draw data in a plane with extract --graph --scale 0", "", ""};
        case RemedyKind::choose_index:
            return {"choose_index", "--index", "choose with --index {}",
                    "choose with --index, by an entry for each axis (a position or :) or by the "
                    "names of axes",
                    "take one of its volumes"};
        case RemedyKind::choose_series:
            return {"choose_series", "--series", "choose one with --series", "", "choose one"};
        case RemedyKind::install_package:
            return {"install_package", "", "install {} and build isonest again (cmake finds it)",
                    "", ""};
        case RemedyKind::say_unit:
            return {"say_unit", "--unit",
                    "give --unit {} for a volume file, or preprocess the volume again with --unit",
                    "give --unit", "preprocess the volume again with --unit"};
        case RemedyKind::world_units:
            return {"world_units", "", "give a plain number", "", ""};
        case RemedyKind::fewer_components:
            return {"fewer_components", "--min-component", "give --min-component {}",
                    "drop the smaller ones with --min-component or --components largest",
                    "drop small components"};
        case RemedyKind::check_url:
            return {"check_url", "", "check the URL", "", ""};
        case RemedyKind::give_credentials:
            return {"give_credentials", "--header", "give credentials in {} or with --header",
                    "give credentials with --header", "give credentials in {}"};
        case RemedyKind::set_variable:
            return {"set_variable", "", "set {} in the environment", "set it in the environment",
                    ""};
        case RemedyKind::serve_ranges:
            return {
                "serve_ranges", "",
                "use a server with range requests (nginx, Apache, S3), or copy it to this machine",
                "", ""};
        case RemedyKind::try_later:
            return {"try_later", "", "try again later", "", ""};
        case RemedyKind::open_again:
            return {"open_again", "", "run again", "", ""};
        case RemedyKind::download:
            return {"download", "", "download it first (curl -fO URL)", "", ""};
    }
    return {"unknown", "", "{}", "", ""};
}

/// The option that sets a member of SourceOptions. `with_form`: followed by the form of its value.
std::string option_of(std::string_view member, bool with_form) {
    constexpr std::array<std::array<std::string_view, 3>, 4> kForms{
        {{"dims", "--dims", " X,Y[,Z]"},
         {"type", "--type", " T"},
         {"offset", "--offset", " BYTES"},
         {"big_endian", "--endian", " END"}}};
    for (const auto& [name, option, form] : kForms) {
        if (name == member) {
            return std::string(option) + std::string(with_form ? form : "");
        }
    }
    return fmt::format("--{}", member);
}

/// "a", "a and b", "a, b and c"; `last` precedes the last item.
std::string joined(const std::vector<std::string>& parts, const char* last) {
    std::string text;
    for (std::size_t i = 0; i < parts.size(); ++i) {
        text += i == 0 ? "" : i + 1 < parts.size() ? ", " : last;
        text += parts[i];
    }
    return text;
}

std::string said_bytes(const std::string& value) {
    std::uint64_t bytes = 0;
    const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), bytes);
    if (error != std::errc{} || end != value.data() + value.size()) {
        return value;
    }
    constexpr std::uint64_t kMega = std::uint64_t{1} << 20U;
    return fmt::format("{}M", bytes / kMega + (bytes % kMega != 0 ? 1 : 0));
}

std::string said(const std::string& value, Say say) {
    if (say == Say::bytes) {
        return said_bytes(value);
    }
    if (say == Say::list) {
        std::string text = value;
        text.erase(std::remove(text.begin(), text.end(), ' '), text.end());
        return text;
    }
    if (say == Say::as_is) {
        return value;
    }
    std::vector<std::string> options;
    for (std::size_t at = 0; at < value.size();) {
        const std::size_t end = std::min(value.find(',', at), value.size());
        options.push_back(option_of(value.substr(at, end - at), say == Say::forms));
        at = end + 1;
    }
    return joined(options, " and ");
}

}  // namespace

std::string name_of(RemedyKind kind) {
    return phrase_of(kind).name;
}

std::string name_of(ErrorKind kind) {
    switch (kind) {
        case ErrorKind::invalid_argument:
            return "invalid_argument";
        case ErrorKind::not_found:
            return "not_found";
        case ErrorKind::corrupt:
            return "corrupt";
        case ErrorKind::unsupported:
            return "unsupported";
        case ErrorKind::io:
            return "io";
        case ErrorKind::limit:
            return "limit";
        case ErrorKind::cancelled:
            return "cancelled";
    }
    return "internal";
}

std::string text_of(const Remedy& remedy, const HasOption& has) {
    const Phrase phrase = phrase_of(remedy.kind);
    std::string_view text = phrase.with;
    if (phrase.option[0] != 0 && !has(phrase.option)) {
        text = phrase.without;
    } else if (remedy.value.empty() && phrase.bare[0] != 0) {
        text = phrase.bare;
    }
    return fmt::format(fmt::runtime(text), said(remedy.value, phrase.say));
}

std::string message_of(const Error& error, const HasOption& has) {
    std::vector<std::string> texts;
    for (const Remedy& remedy : error.remedies()) {
        texts.push_back(text_of(remedy, has));
    }
    std::string what = error.what();
    if (texts.empty()) {
        return what;
    }
    // A message that is a list is followed by a line of its own.
    const char* const before = what.find('\n') == std::string::npos ? "; " : "\n";
    return what + before + joined(texts, texts.size() > 2 ? ", or " : " or ");
}

Json json_of(const Error& error, const HasOption& has) {
    Json remedies = Json::array();
    for (const Remedy& remedy : error.remedies()) {
        remedies.push_back({{"kind", name_of(remedy.kind)},
                            {"value", remedy.value},
                            {"text", text_of(remedy, has)}});
    }
    return {{"kind", name_of(error.kind())},
            {"message", message_of(error, has)},
            {"file", error.place().file},
            {"inside", error.place().inside},
            {"remedies", remedies}};
}

}  // namespace isonest::detail::cli
