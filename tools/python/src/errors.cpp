#include "tools/python/src/errors.h"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <filesystem>
#include <string>
#include <string_view>
#include <system_error>

#include <isonest/error.h>

namespace isonest::python {
namespace {

/// What can be done, in the words of this package; {} is the remedy's value.
std::string_view words_of(RemedyKind kind) {
    switch (kind) {
        case RemedyKind::replace_existing:
            return "give replace=True to replace it";
        case RemedyKind::choose_dataset:
            return "say which one with dataset=";
        case RemedyKind::describe_numbers:
            return "for raw numbers give shape= and dtype=";
        case RemedyKind::place_in_world:
            return "give another {}";
        case RemedyKind::more_memory:
            return "give memory={} or more";
        case RemedyKind::smaller_chunk:
            return "give a smaller chunk=";
        case RemedyKind::fewer_threads:
            return "give threads={}";
        case RemedyKind::resume:
            return "call it again with resume=True to go on";
        case RemedyKind::no_resume:
            return "leave out resume=True";
        case RemedyKind::make_fields:
            return "preprocess the volume again with these among its indicators=: {}";
        case RemedyKind::other_field:
            return "name another field: {}";
        case RemedyKind::larger_error:
            return "allow a larger error=";
        case RemedyKind::smaller_box:
            return "take a box= of it";
        case RemedyKind::other_format:
            return "use {}";
        case RemedyKind::state_missing:
            return "give the missing= of preprocess";
        case RemedyKind::newer_version:
            return "use a newer isonest";
        case RemedyKind::correct_numbers:
            return "check {}";
        case RemedyKind::leave_out:
            return "leave out {}";
        case RemedyKind::other_name:
            return "give another name";
        case RemedyKind::free_space:
            return "free some space or choose another folder";
        case RemedyKind::good_copy:
            return "restore the file from a good copy";
        case RemedyKind::make_store:
            return "make a store with isonest.preprocess";
        case RemedyKind::preprocess_again:
            return "preprocess the volume again";
        case RemedyKind::smaller_input_chunk:
            return "store the input in smaller chunks";
        case RemedyKind::raise_limit:
            return "raise the limit ({})";
        case RemedyKind::same_options:
            return "give those";
        case RemedyKind::remove_leftover:
            return "delete it";
        case RemedyKind::smaller_picture:
            return "draw a smaller picture";
        case RemedyKind::less_memory:
            return "give less memory=";
        case RemedyKind::other_scale:
            return "give another scale";
        case RemedyKind::scale_values:
            return "scale the data, or take an offset off them, first";
        case RemedyKind::graph:
            return "draw its graph with Store.graph";
        case RemedyKind::choose_index:
            return "choose with index={{{}}}";
        case RemedyKind::choose_series:
            return "say which one with series=";
        case RemedyKind::install_package:
            return "install {} and build isonest again";
        case RemedyKind::say_unit:
            return "give unit='{}' with the volume, to isonest.preprocess or isonest.isosurface";
        case RemedyKind::world_units:
            return "give a number alone, in the volume's own unit";
        case RemedyKind::fewer_components:
            return "give min_component={}";
        case RemedyKind::check_url:
            return "check the URL";
        case RemedyKind::give_credentials:
            return "give credentials in {} or with headers=";
        case RemedyKind::set_variable:
            return "set {} in the environment";
        case RemedyKind::serve_ranges:
            return "put it on a server that answers requests for a part (nginx, Apache, S3), or "
                   "copy it to this machine";
        case RemedyKind::try_later:
            return "try again later";
        case RemedyKind::open_again:
            return "open it again";
        case RemedyKind::download:
            return "download it first";
    }
    return "";
}

/// The members of SourceOptions, as this package calls them.
std::string in_our_names(const std::string& members) {
    std::string text;
    for (std::size_t at = 0; at < members.size();) {
        const std::size_t end = std::min(members.find(',', at), members.size());
        std::string name = members.substr(at, end - at);
        if (name == "dims") {
            name = "shape";
        } else if (name == "type" || name == "big_endian") {
            name = "dtype";
        }
        text += (text.empty() ? "" : " and ") + name + "=";
        at = end + 1;
    }
    return text;
}

/// "t=0,c=:" as the entries of a dict: "'t': 0, 'c': None".
std::string entries_of_dict(const std::string& index) {
    std::string text;
    for (std::size_t at = 0; at < index.size();) {
        const std::size_t end = std::min(index.find(',', at), index.size());
        const std::string entry = index.substr(at, end - at);
        const std::size_t sign = entry.rfind('=');
        const std::string position = sign < entry.size() ? entry.substr(sign + 1) : "0";
        text += fmt::format("{}'{}': {}", text.empty() ? "" : ", ", entry.substr(0, sign),
                            position == ":" ? "None" : position);
        at = end + 1;
    }
    return text;
}

std::string text_of(const Remedy& remedy) {
    if (remedy.kind == RemedyKind::choose_index && remedy.value.empty()) {
        return "choose with index=, an entry per axis (5, None, None, None) or by name or number "
               "{'time': 5}";
    }
    if (remedy.value.empty() && remedy.kind == RemedyKind::other_field) {
        return "name another field";
    }
    if (remedy.value.empty() && remedy.kind == RemedyKind::more_memory) {
        return "give more memory=";
    }
    if (remedy.value.empty() && remedy.kind == RemedyKind::fewer_components) {
        return "drop the smaller ones with min_component= or components='largest'";
    }
    const bool names_options = remedy.kind == RemedyKind::leave_out ||
                               remedy.kind == RemedyKind::correct_numbers ||
                               remedy.kind == RemedyKind::place_in_world;
    return fmt::format(fmt::runtime(words_of(remedy.kind)),
                       names_options                             ? in_our_names(remedy.value)
                       : remedy.kind == RemedyKind::choose_index ? entries_of_dict(remedy.value)
                                                                 : remedy.value);
}

bool is_about_memory(const Error& error) {
    return std::any_of(error.remedies().begin(), error.remedies().end(), [](const Remedy& r) {
        return r.kind == RemedyKind::more_memory || r.kind == RemedyKind::less_memory;
    });
}

const char* class_of(const Error& error) {
    switch (error.kind()) {
        case ErrorKind::invalid_argument:
            return "InvalidArgumentError";
        case ErrorKind::not_found:
            return "NotFoundError";
        case ErrorKind::corrupt:
            return "CorruptError";
        case ErrorKind::unsupported:
            return "UnsupportedError";
        case ErrorKind::io:
            return "InputOutputError";
        case ErrorKind::limit:
            return is_about_memory(error) ? "MemoryLimitError" : "LimitError";
        case ErrorKind::cancelled:
            return "CancelledError";
    }
    return "Error";
}

void raise(const Error& error) {
    py::list remedies;
    std::string message = error.what();
    const char* between = message.find('\n') == std::string::npos ? "; " : "\n";
    for (const Remedy& remedy : error.remedies()) {
        const std::string text = text_of(remedy);
        if (!text.empty()) {
            message += between + text;
            between = ", or ";
            remedies.append(text);
        }
    }
    const py::object type = py::module_::import("isonest._errors").attr(class_of(error));
    const py::object exception = type(message);
    exception.attr("file") = error.place().file;
    exception.attr("inside") = error.place().inside;
    exception.attr("problem") = error.problem();
    exception.attr("remedies") = py::tuple(remedies);
    PyErr_SetObject(type.ptr(), exception.ptr());
}

}  // namespace

void translate_errors() {
    // NOLINTNEXTLINE(performance-unnecessary-value-param): pybind11's signature
    py::register_exception_translator([](std::exception_ptr failure) {
        try {
            if (failure) {
                std::rethrow_exception(failure);
            }
        } catch (const Error& error) {
            raise(error);
        } catch (const std::filesystem::filesystem_error& error) {
            raise(Error(ErrorKind::io, {error.path1().string()}, error.code().message()));
        }
    });
}

}  // namespace isonest::python
