# Writes page_files.cpp (page_files.h), which embeds all files of FOLDER.
# usage: cmake -D FOLDER=... -D OUTPUT=... -P embed_page.cmake
file(GLOB files ${FOLDER}/*)
list(SORT files)
set(type_html "text/html; charset=utf-8")
set(type_js "text/javascript; charset=utf-8")
set(type_mjs "text/javascript; charset=utf-8")
set(type_css "text/css; charset=utf-8")
set(type_txt "text/plain; charset=utf-8")
set(type_svg "image/svg+xml")
set(type_png "image/png")
set(type_wasm "application/wasm")
set(symbols "")
set(rows "")
set(number 0)
foreach(file IN LISTS files)
  get_filename_component(name ${file} NAME)
  get_filename_component(ending ${file} LAST_EXT)
  string(SUBSTRING ${ending} 1 -1 ending)
  if(NOT DEFINED type_${ending})
    message(FATAL_ERROR "the page has a file of unknown type: ${name}")
  endif()
  string(APPEND symbols
    "__asm__(\".section .rodata\\n.balign 16\\nisonest_page_${number}:\\n.incbin \\\"${file}\\\"\\n\"\n"
    "        \"isonest_page_${number}_end:\\n.byte 0\\n.previous\\n\");\n"
    "extern const char isonest_page_${number}_begin[] __asm__(\"isonest_page_${number}\");\n"
    "extern const char isonest_page_${number}_end[] __asm__(\"isonest_page_${number}_end\");\n")
  string(APPEND rows "    {\"/${name}\", \"${type_${ending}}\", isonest_page_${number}_begin, isonest_page_${number}_end},\n")
  math(EXPR number "${number} + 1")
endforeach()
if(number EQUAL 0)
  message(FATAL_ERROR "${FOLDER} holds no page")
endif()
file(WRITE ${OUTPUT} "// Made by embed_page.cmake.
#include \"tools/view/page_files.h\"

#include <array>

${symbols}
namespace {

struct Row {
    std::string_view path;
    std::string_view type;
    const char* begin;
    const char* end;
};
const std::array<Row, ${number}> kRows{{
${rows}}};
}  // namespace

namespace isonest::detail::view {

std::optional<PageFile> page_file(std::string_view path) {
    const std::string_view name = path == \"/\" ? \"/index.html\" : path;
    for (const Row& row : kRows) {
        if (row.path == name) {
            return PageFile{row.type, {row.begin, static_cast<std::size_t>(row.end - row.begin)}};
        }
    }
    return std::nullopt;
}

std::vector<NamedPageFile> page_files() {
    std::vector<NamedPageFile> files;
    for (const Row& row : kRows) {
        files.push_back({row.path, {row.type, {row.begin, static_cast<std::size_t>(row.end - row.begin)}}});
    }
    return files;
}

}  // namespace isonest::detail::view
")
