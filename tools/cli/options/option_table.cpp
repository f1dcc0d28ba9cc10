#include "tools/cli/options/option_table.h"

#include <fmt/format.h>

#include <array>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <string_view>

namespace isonest::detail::cli {
namespace {

struct OptionRow {
    std::string_view
        commands;           ///< separated by blanks; empty: all commands without a row of their own
    std::string_view name;  ///< "--iso", or the name of a positional argument, "INPUT"
    const char* group;      ///< null for a positional argument
    const char* form;       ///< of the value: "V[,V...]"; for a flag with an optional value: "[=N]"
    /// One line. {} is replaced by the description set by the command: the option's default.
    const char* words;
    /// The argument in Python and its type, without None: "error: float". `choice`: the words that
    /// the form or the text lists. In parentheses: why there is none. Empty: a positional argument.
    std::string_view python;
};

constexpr std::array kGroups{kWhat,   kHowClose, kWhichParts, kWritten, kPicture,
                             kServer, kReading,  kNetwork,    kLimits,  kGeneral};

constexpr std::string_view kDrawnElsewhere = "(other packages draw pictures and plots)";
constexpr std::string_view kSitesByProgram = "(the program alone writes sites)";
constexpr std::string_view kSeriesByProgram = "(only the program makes series)";
constexpr std::string_view kNumpyMakes = "(NumPy makes arrays)";

// In the order of the help.
// clang-format off
constexpr OptionRow kOptions[] = {
    // Input.
    {"", "INPUT", nullptr, "", "a store, or a volume that preprocess reads", ""},
    {"extract", "INPUT", nullptr, "", "a store or volume: file, folder, slices, URL or -", ""},
    {"preprocess", "INPUT", nullptr, "", "the volume: file, folder, slices, URL or -", ""},
    {"", "STORE", nullptr, "", "made by isonest preprocess: a file or a URL", ""},
    {"publish", "STORE", nullptr, "", "made by isonest preprocess: files, series, or URLs", ""},
    {"", "MESH", nullptr, "", ".ply .stl .obj .glb .3mf .vtp .vtkhdf or .ngmesh", ""},
    {"", "NAME", nullptr, "", "one of {}", ""},

    // The kind of output.
    {"", "--iso", kWhat, "V[,V...]", "the isovalue, or several from one pass over the data", "iso: float | Sequence[float]"},
    {"", "--label", kWhat, "ID", "in place of --iso: a label, by its number or name", "label: int | str"},
    {"", "--labels", kWhat, "all|ID[,ID...]", "in place of --iso: a mesh for each, in folder MESH", "labels: Sequence[int | str]"},
    {"", "--graph", kWhat, "", "of data in a plane: the surface z = value", "(the method Store.graph)"},
    {"", "--scale", kWhat, "S", "with --graph: z = S times the value [1]", "scale: float"},
    {"", "--smooth", kWhat, "[=N]", "labels: smooth surfaces, by N passes, 0 to 64 [16]", "smooth: bool | int"},
    {"", "--keep-nodes", kWhat, "", "with --smooth, simplified: no node changes sides", "keep_nodes: bool"},
    {"", "--interfaces", kWhat, "", "with --labels --smooth: all interfaces in one mesh", "(the method Store.interfaces)"},
    {"", "--cells", kWhat, "tet|hex|quad", "shape of the cells; quad: of --graph [the best]", "cells: choice"},
    {"slice", "--cells", kWhat, "tet|hex", "shape of the cells [tet]", "cells: choice"},
    {"", "--vertices", kWhat, "linear|exact", "interpolate on edges, or follow the data [linear]", "vertices: choice"},
    {"", "--plane", kWhat, "NX,NY,NZ,D", "the plane x NX + y NY + z NZ = D", "normal: Point"},
    {"", "--contours", kWhat, "V,V,...", "lines at these values; in a mesh, the lines alone", "contours: Sequence[float]"},
    {"", "--histogram", kWhat, "", "how often values occur, and suggested isovalues", "(the method Store.histogram)"},
    {"info", "--level", kWhat, "L", "level of the values [finest up to {} M nodes]", "level: int"},
    {"export", "--field", kWhat, "NAME", "values, or an indicator, as deviation_bar [values]", "field: str"},
    {"export", "--level", kWhat, "L", "every 2^L-th value; indicators of level L and up [0]", "level: int"},
    {"", "--indicators", kWhat, "NAMES", "the indicators [{}]", "indicators: str | Sequence[str]"},
    {"", "--own", kWhat, "NAME=FILE", "indicator from a volume of numbers: own:NAME_bar", "own: Mapping[str, Any]"},
    {"smooth", "--steps", kWhat, "N", "how many steps", "steps: int"},
    {"", "--tau", kWhat, "T", "time of a step, in squared world units", "tau: float"},
    {"", "--lambda", kWhat, "L", "gradient at which half flows", "lambda_: float"},
    {"", "--sigma", kWhat, "S", "smooths the gradient, in world units [least spacing]", "sigma: float"},
    {"smooth", "--threshold", kHowClose, "E", "skip nodes with a smaller grad_linf_bar [0 = none]", "threshold: float"},
    {"study", "--fields", kWhat, "NAMES", "fields to compare, with commas [those of the store]", "fields: Sequence[str]"},
    {"study", "--iso", kWhat, "V", "also count what extracting this isosurface visits", "iso: float"},
    {"study", "--plane", kWhat, "NX,NY,NZ,D", "a slice, x NX + y NY + z NZ = D, not the volume", "plane: tuple[Point, float]"},
    {"", "--norm", kWhat, "P", "also the errors of value and gradient in L^P", "norm: float"},
    {"", "--graph-distance", kWhat, "", "also the distance of the graphs; may take long", "graph_distance: bool"},
    {"study", "--steps", kHowClose, "N", "number of thresholds [25]", "steps: int"},
    {"", "--least", kHowClose, "T", "the smallest threshold [1e-4]", "least: float"},
    {"", "--quick", kWhat, "", "takes seconds: chunk table, a sample of checksums", "quick: bool"},
    {"", "--deep", kWhat, "", "everything, also HDF5's own chunk index", "deep: bool"},
    {"", "--source", kWhat, "INPUT", "the volume that the store was made from", "source: Any"},
    {"make-volume", "--size", kWhat, "N|X,Y[,Z]", "nodes per axis", kNumpyMakes},
    {"make-volume", "--type", kWhat, "T", "value type; integers use its whole range [float32]", kNumpyMakes},
    {"", "--seed", kWhat, "N", "of noise, or of the mixture of cahn-hilliard [1]", kNumpyMakes},
    {"", "--check", kWhat, "URL", "check a server: URL of a published folder or store", kSitesByProgram},
    {"publish", "--origin", kWhat, "URL", "with --check: page's server [{}]", kSitesByProgram},

    // Accuracy.
    {"", "--error", kHowClose, "E|P%", "largest error of the value, or in % of the range [0]", "error: float"},
    {"", "--error-relative", kHowClose, "R", "the same, as a fraction of the data's range", "error_relative: float"},
    {"", "--distance", kHowClose, "D[UNIT]", "largest distance to the full surface: 0.5mm, 1voxel", "distance: float | str"},
    {"", "--triangles", kHowClose, "N", "at most N triangles, as close as possible", "triangles: int"},
    {"", "--by", kHowClose, "distance|error", "what --triangles makes small [distance]", "by: choice"},
    {"", "--effort", kHowClose, "none|fast|best", "how far to simplify at the same error [best]", "effort: choice"},
    {"", "--indicator", kHowClose, "NAME", "[deviation], plus (looser) or estimate (no bound)", "indicator: choice"},
    {"", "--stop", kHowClose, "FIELD", "in place of an error: refine while this field is not", "stop: str"},
    {"", "--threshold", kHowClose, "T", "... below this threshold, in the field's units [0]", "threshold: float"},
    {"", "--threshold-relative", kHowClose, "T", "... below this fraction of its largest value", "threshold_relative: float"},
    {"", "--focus", kHowClose, "X,Y,Z[,X1,Y1,Z1]", "the error holds at this point, or in this box", "focus: Point | Box"},
    {"", "--falloff", kHowClose, "F", "the error at distance d is multiplied by 1 + F d", "falloff: float"},
    {"", "--camera", kHowClose, "X,Y,Z", "stop where a viewer at this place sees no difference", "camera: Point"},
    {"", "--pixels", kHowClose, "N", "with --camera: the smallest visible size, pixels [1]", "pixels: float"},
    {"", "--fov", kHowClose, "DEG", "with --camera: vertical field of view, degrees [40]", "fov: float"},
    {"", "--height", kHowClose, "PIXELS", "with --camera: height of the picture, pixels [1080]", "height: int"},
    {"", "--bound", kHowClose, "FIELD", "field that rules out empty cells [the tightest]", "bound: str"},
    {"", "--keep-analysis", kHowClose, "[=FOLDER]", "keep an analysis that makes further distances fast", "keep_analysis: bool | Path"},

    // Regions and parts.
    {"", "--box", kWhichParts, "x0,y0,z0,x1,y1,z1", "only what is inside this box", "box: Box"},
    {"", "--components", kWhichParts, "N|all", "keep the N largest (or: largest); all: count them", "components: int | choice"},
    {"", "--min-component", kWhichParts, "N", "drop pieces of fewer triangles", "min_component: int"},
    {"", "--min-volume", kWhichParts, "V", "drop closed pieces of less volume, in world units", "min_volume: float"},
    {"", "--times", kWhichParts, "T[,T...]", "steps of a series: these times; START:STOP[:STEP]", "(the method Series.at)"},
    {"", "--close", kWhichParts, "[=below|above]", "close it at the volume's faces: outside is [below]", "close: bool | choice"},
    {"", "--view", kWhichParts, "X,Y,Z", "leave out what faces away from this view direction", "view: Point"},
    {"", "--cull-by", kWhichParts, "FIELD", "with --view: normal_turn_plus or grad_linf_plus", "cull_by: str"},
    {"", "--manifold", kWhichParts, "", "separate sheets that touch in edges or vertices", "manifold: bool"},

    // Output.
    {"extract", "--output", kWritten, "MESH", ".ply .stl .obj .vtp .vtkhdf .glb .3mf", "path: Path"},
    {"slice", "--output", kWritten, "OUT", ".png; mesh: .ply .vtp .vtkhdf .glb", "path: Path"},
    {"preprocess", "--output", kWritten, "STORE", "the store, as scan.isonest", "store: Path"},
    {"export make-volume", "--output", kWritten, "FILE", ".h5 .nrrd .nii .vti .npy .mha .raw", "output: Path"},
    {"picture", "--output", kWritten, "OUT.png", "the picture; --turntable: OUT_000.png ...", kDrawnElsewhere},
    {"smooth", "--output", kWritten, "OUT", ".h5 .nrrd .raw; of a plane .png too", "output: Path"},
    {"info", "--output", kWritten, "PLOT", "the histogram as a plot, .png or .svg", kDrawnElsewhere},
    {"study", "--out", kWritten, "FOLDER", "the folder for the table and the plots", kDrawnElsewhere},
    {"publish", "--output", kWritten, "FOLDER", "the folder to write", kSitesByProgram},
    {"extract", "--normals", kWritten, "", "vertex normals, from the gradient of the data", "normals: bool"},
    {"slice", "--normals", kWritten, "", "vertex normals: the plane's", "normals: bool"},
    {"view", "--vertex-values", kWhat, "NAME=STORE", "colour surfaces by the values of STORE, of any lattice", "(only the page)"},
    {"", "--vertex-values", kWritten, "STORE", "vertex values of STORE; with NAME=STORE any lattice", "vertex_values: Store"},
    {"", "--vertex-error", kWritten, "FIELD", "how far vertices may be off, by this field", "vertex_error: str"},
    {"", "--space", kWritten, "AXES", "patient axes: ras, lps, as-stored [ras where known]", "space: choice"},
    {"", "--up", kWritten, "y|z", "the axis that points up in .glb and .obj [z]", "up: choice"},
    {"", "--mesh-unit", kWritten, "U", "unit of the positions in the mesh file: mm, m, ...", "mesh_unit: str"},
    {"extract", "--colors", kWritten, "NAME", "vertex colours in .glb and .ply: viridis, gray, ...", kDrawnElsewhere},
    {"extract", "--range", kWritten, "LOW,HIGH|WINDOW", "first, last value [all]; bone, lung, soft, brain", kDrawnElsewhere},
    {"", "--format", kWritten, "NAME", "3dtiles; --labels: ply, ..., neuroglancer[-sharded]", "(by the file name passed to Mesh.save)"},
    {"", "--georeference", kWritten, "PLACE", "3dtiles: the origin's LON,LAT[,HEIGHT] on the globe", "(the program alone writes tiles)"},
    {"", "--over", kWritten, "zarr|precomputed", "the volume that Neuroglancer shows [zarr]", "(the argument shift of Mesh.save)"},
    {"", "--volume-interval", kWritten, "", "with --close: bounds on the full solid's volume", "volume_interval: bool"},
    {"", "--quality", kWritten, "", "report the angles of the triangles", "quality: bool"},
    {"smooth", "--grid", kWritten, "FILE", "grid of the result: 1 at its nodes; of a plane .png", "grid: bool"},
    {"", "--snapshots", kWritten, "N,N,...", "write these steps too, as OUT-N", "snapshots: Sequence[int]"},
    {"", "--chunk", kWritten, "N", "nodes per axis of a chunk, a power of two [{}]", "chunk: int"},
    {"", "--compression", kWritten, "LEVEL", "zstd level, 1 to 19 [{}]", "compression: int"},
    {"", "--tolerance", kWritten, "T", "round values, by at most 2, 0.5%, bits:4 or auto", "tolerance: float | str"},
    {"", "--exact", kWritten, "", "indicators in full precision, not in 16 bits", "exact: bool"},
    {"", "--link", kWritten, "URL", "URL of a store, instead of a copy in the folder", kSitesByProgram},
    {"", "--hard-link", kWritten, "", "hard-link the stores instead of copying them", kSitesByProgram},
    {"", "--title", kWritten, "TEXT", "above the picture; once, or once for each store", kSitesByProgram},
    {"", "--description", kWritten, "TEXT", "likewise; an empty line begins a paragraph", kSitesByProgram},
    {"", "--license", kWritten, "TEXT", "likewise", kSitesByProgram},
    {"", "--force", kWritten, "", "replace what is there", "replace: bool"},
    {"publish", "--force", kWritten, "", "replace a folder that isonest publish made", kSitesByProgram},
    {"", "--resume", kWritten, "", "continue a killed run, or keep an interrupted one", "resume: bool"},
    {"preprocess", "--times", kWritten, "auto|T[,T...]", "make a series with these times; START:STOP:STEP", kSeriesByProgram},
    {"", "--append", kWritten, "", "add steps to a series; known ones are skipped", kSeriesByProgram},
    {"", "--scratch", kLimits, "FOLDER", "temporary files of a rank [the store's folder]", "(of isonest-mpi)"},

    // Pictures.
    {"", "--size", kPicture, "WxH", "pixels [{}]", kDrawnElsewhere},
    {"", "--colors", kPicture, "NAME", "viridis, gray, hot, coolwarm, ...; NAME_r: reversed", kDrawnElsewhere},
    {"slice", "--colors", kPicture, "NAME", "of pictures, .glb, .ply: viridis, gray, ...; NAME_r", kDrawnElsewhere},
    {"", "--plain", kPicture, "", "without axes, scale bar and colour bar", kDrawnElsewhere},
    {"", "--range", kPicture, "LOW,HIGH", "values of the first and last colour [all]", kDrawnElsewhere},
    {"slice", "--range", kPicture, "LOW,HIGH|WINDOW", "first, last value [all]; bone, lung, soft, brain", kDrawnElsewhere},
    {"slice", "--grid", kPicture, "", "draw the edges of the triangles", kDrawnElsewhere},
    {"picture", "--view", kPicture, "VIEW", "front, back, left, right, top, bottom, iso, X,Y,Z", kDrawnElsewhere},
    {"", "--turntable", kPicture, "N", "N pictures from all around", kDrawnElsewhere},
    {"", "--wireframe", kPicture, "", "draw the edges of the triangles too", kDrawnElsewhere},
    {"", "--flat", kPicture, "", "one shade per triangle", kDrawnElsewhere},
    {"", "--color-by", kPicture, "NAME", "vertex property for the colours, or none [value]", kDrawnElsewhere},
    {"", "--color", kPicture, "R,G,B", "of the surface, each 0 to 255 [110,156,204]", kDrawnElsewhere},

    // Reading a volume.
    {"", "--dataset", kReading, "PATH", "the array, in a file of several (HDF5, Zarr, .npz)", "dataset: str"},
    {"", "--series", kReading, "UID", "the DICOM series, if there are several", "series: str"},
    {"", "--index", kReading, "AT", "of time steps or channels: 5,:,:,: or time=5,c=0", "index: Any"},
    {"", "--crop", kReading, "X0:X1,Y0:Y1,Z0:Z1", "nodes from X0 to X1 - 1; -5: from the end", "crop: Sequence[slice]"},
    {"", "--every", kReading, "N|X,Y[,Z]", "each N-th node only", "every: int | Sequence[int]"},
    {"", "--periodic", kReading, "AXES", "axes that continue with their first nodes: x,y", "periodic: str"},
    {"", "--repeat", kReading, "NX,NY[,NZ]", "periods along the periodic axes [1,1,1]", "repeat: Sequence[int]"},
    {"", "--dims", kReading, "X,Y[,Z]", "raw: nodes per axis, fastest first", "shape: Sequence[int]"},
    {"", "--type", kReading, "T", "raw: uint8, int16, float32, ... or u1, i2, >f4", "dtype: Any"},
    {"", "--endian", kReading, "END", "raw: big or little [little]", "dtype: Any"},
    {"", "--offset", kReading, "BYTES", "raw: bytes to skip [0]", "offset: int"},
    {"", "--spacing", kReading, "X,Y[,Z]", "distance of the nodes, in place of the file's", "spacing: Sequence[float]"},
    {"", "--origin", kReading, "X,Y[,Z]", "position of the first node, in place of the file's", "origin: Sequence[float]"},
    {"", "--unit", kReading, "U", "unit of length, in place of the file's: mm, um, ...", "unit: str"},
    {"", "--frame", kReading, "ras|lps", "patient axes of the world, in place of the file's", "frame: choice"},
    {"", "--missing", kReading, "V", "this value means missing data, as NaN does", "missing: float"},
    {"preprocess info check", "--labels", kReading, "", "values are labels: whole numbers, with names", "labels: bool"},
    {"", "--label-names", kReading, "FILE", "names and colours (FreeSurfer, Slicer, ITK-SNAP)", "label_names: Path"},
    {"", "--keep-store", kReading, "STORE", "keep the store that is made from a volume", "(the function isonest.preprocess)"},
    {"", "--header", kNetwork, "HEADER", "sent with each request: 'Name: value', or @FILE", "headers: Headers"},
    {"", "--cache", kNetwork, "FOLDER[:SIZE]", "keep what was fetched here, up to SIZE [1G]", "cache: Path"},

    // The server of `view`.
    {"", "--port", kServer, "P", "to listen on; 0 = any that is free [{}]", "port: int"},
    {"", "--address", kServer, "IP", "network interface; 0.0.0.0 = all [127.0.0.1]", "(always 127.0.0.1)"},
    {"", "--token", kServer, "", "ask for a token on this machine, too", "(always)"},
    {"", "--open", kServer, "", "open the page in the browser", "open: bool"},

    // Resources.
    {"", "--memory", kLimits, "SIZE", "heap to stay within [{}]", "memory: Bytes"},
    {"", "--threads", kLimits, "N", "threads; 0 = one per core [0]", "threads: int"},
    {"", "--json", kGeneral, "", "print one JSON object in place of text", "(results are returned)"},
    {"", "--quiet", kGeneral, "", "no progress, and no text where all is well", "(nothing is printed)"},
    {"", "--help", kGeneral, "", "print this help; with --json, for programs", "(help() prints the documentation)"},
};
// clang-format on

bool has_word(std::string_view words, std::string_view word) {
    for (std::size_t at = words.find(word); at != std::string_view::npos;
         at = words.find(word, at + 1)) {
        const std::size_t end = at + word.size();
        if ((at == 0 || words[at - 1] == ' ') && (end == words.size() || words[end] == ' ')) {
            return true;
        }
    }
    return false;
}

const OptionRow& row_of(std::string_view command, std::string_view name) {
    const OptionRow* found = nullptr;
    for (const OptionRow& row : kOptions) {
        if (row.name == name &&
            (has_word(row.commands, command) || (row.commands.empty() && found == nullptr))) {
            found = &row;
        }
    }
    if (found == nullptr) {
        throw std::logic_error(fmt::format("the table of options has no {} of {}", name, command));
    }
    return *found;
}

std::string name_of(const CLI::Option& option) {
    return option.get_positional() ? option.get_name(true) : "--" + option.get_lnames().front();
}

nlohmann::ordered_json json_of(const CLI::Option& option, const OptionRow& row) {
    nlohmann::ordered_json json{{"name", row.name},
                                {"value", row.form},
                                {"text", option.get_description()},
                                {"required", option.get_required()}};
    if (row.group == nullptr) {
        return json;
    }
    json["group"] = row.group;
    const std::size_t colon = row.python.find(": ");
    json["python"] =
        row.python.front() == '('
            ? nlohmann::ordered_json{{"none", row.python.substr(1, row.python.size() - 2)}}
            : nlohmann::ordered_json{{"argument", row.python.substr(0, colon)},
                                     {"type", row.python.substr(colon + 2)}};
    return json;
}

}  // namespace

std::span<const char* const> option_groups() {
    return kGroups;
}

std::vector<const CLI::Option*> options_in(const CLI::App& command, const char* group) {
    std::vector<const CLI::Option*> options;
    for (const OptionRow& row : kOptions) {
        const CLI::Option* const option = command.get_option_no_throw(std::string(row.name));
        if (option != nullptr && option->get_group() == group &&
            &row_of(command.get_name(), row.name) == &row) {
            options.push_back(option);
        }
    }
    return options;
}

void describe_options(CLI::App& command) {
    for (CLI::Option* const option :
         command.get_options([](const CLI::Option* /*any*/) { return true; })) {
        const OptionRow& row = row_of(command.get_name(), name_of(*option));
        option->description(fmt::format(fmt::runtime(row.words), option->get_description()));
        if (row.group != nullptr) {
            option->group(row.group)->type_name(row.form);
        }
    }
}

nlohmann::ordered_json options_json(const CLI::App& command) {
    nlohmann::ordered_json options = nlohmann::ordered_json::array();
    for (const OptionRow& row : kOptions) {
        const CLI::Option* const option = command.get_option_no_throw(std::string(row.name));
        if (option != nullptr && &row_of(command.get_name(), row.name) == &row) {
            options.push_back(json_of(*option, row));
        }
    }
    return options;
}

}  // namespace isonest::detail::cli
