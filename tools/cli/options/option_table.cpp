#include "tools/cli/options/option_table.h"

#include <fmt/format.h>

#include <array>
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
};

constexpr std::array kGroups{kWhat,   kHowClose, kWhichParts, kWritten, kPicture,
                             kServer, kReading,  kNetwork,    kLimits,  kGeneral};

// In the order of the help.
// clang-format off
constexpr OptionRow kOptions[] = {
    // Input.
    {"", "INPUT", nullptr, "", "a store, or a volume that preprocess reads"},
    {"extract", "INPUT", nullptr, "", "a store or volume: file, folder, slices, URL or -"},
    {"preprocess", "INPUT", nullptr, "", "the volume: file, folder, slices, URL or -"},
    {"", "STORE", nullptr, "", "made by isonest preprocess: a file or a URL"},
    {"publish", "STORE", nullptr, "", "made by isonest preprocess: files, or URLs"},
    {"", "MESH", nullptr, "", ".ply .stl .obj .glb .3mf .vtp .vtkhdf or .ngmesh"},
    {"", "NAME", nullptr, "", "one of {}"},

    // The kind of output.
    {"", "--iso", kWhat, "V[,V...]", "the isovalue, or several from one pass over the data"},
    {"", "--label", kWhat, "ID", "in place of --iso: a label, by its number or name"},
    {"", "--labels", kWhat, "all|ID[,ID...]", "in place of --iso: a mesh for each, in folder MESH"},
    {"", "--graph", kWhat, "", "of data in a plane: the surface z = value"},
    {"", "--scale", kWhat, "S", "with --graph: z = S times the value [1]"},
    {"", "--smooth", kWhat, "[=N]", "labels: smooth surfaces, by N passes, 0 to 64 [16]"},
    {"", "--keep-nodes", kWhat, "", "with --smooth, simplified: no node changes sides"},
    {"", "--interfaces", kWhat, "", "with --labels --smooth: all interfaces in one mesh"},
    {"", "--cells", kWhat, "tet|hex|quad", "shape of the cells; quad: of --graph [the best]"},
    {"slice", "--cells", kWhat, "tet|hex", "shape of the cells [tet]"},
    {"", "--vertices", kWhat, "linear|exact", "interpolate on edges, or follow the data [linear]"},
    {"", "--plane", kWhat, "NX,NY,NZ,D", "the plane x NX + y NY + z NZ = D"},
    {"", "--contours", kWhat, "V,V,...", "lines at these values; in a mesh, the lines alone"},
    {"", "--histogram", kWhat, "", "how often values occur, and suggested isovalues"},
    {"info", "--level", kWhat, "L", "level of the values [finest up to {} M nodes]"},
    {"export", "--field", kWhat, "NAME", "values, or an indicator, as deviation_bar [values]"},
    {"export", "--level", kWhat, "L", "every 2^L-th value; indicators of level L and up [0]"},
    {"", "--indicators", kWhat, "NAMES", "as above [{}]"},
    {"", "--own", kWhat, "NAME=FILE", "indicator from a volume of numbers: own:NAME_bar"},
    {"smooth", "--steps", kWhat, "N", "how many steps"},
    {"", "--tau", kWhat, "T", "time of a step, in squared world units"},
    {"", "--lambda", kWhat, "L", "gradient at which half flows"},
    {"", "--sigma", kWhat, "S", "smooths the gradient, in world units [least spacing]"},
    {"smooth", "--threshold", kHowClose, "E", "skip nodes with a smaller grad_linf_bar [0 = none]"},
    {"study", "--fields", kWhat, "NAMES", "fields to compare, with commas [those of the store]"},
    {"study", "--iso", kWhat, "V", "also count what extracting this isosurface visits"},
    {"study", "--plane", kWhat, "NX,NY,NZ,D", "a slice, x NX + y NY + z NZ = D, not the volume"},
    {"", "--norm", kWhat, "P", "also the errors of value and gradient in L^P"},
    {"", "--graph-distance", kWhat, "", "also the distance of the graphs; may take long"},
    {"study", "--steps", kHowClose, "N", "number of thresholds [25]"},
    {"", "--least", kHowClose, "T", "the smallest threshold [1e-4]"},
    {"", "--quick", kWhat, "", "takes seconds: chunk table, a sample of checksums"},
    {"", "--deep", kWhat, "", "everything: also HDF5's own index of the chunks"},
    {"", "--source", kWhat, "INPUT", "the volume that the store was made from"},
    {"make-volume", "--size", kWhat, "N|X,Y[,Z]", "nodes per axis"},
    {"make-volume", "--type", kWhat, "T", "value type; integers use its whole range [float32]"},
    {"", "--seed", kWhat, "N", "of noise, or of the mixture of cahn-hilliard [1]"},
    {"", "--check", kWhat, "URL", "check a server: URL of a published folder or store"},
    {"publish", "--origin", kWhat, "URL", "with --check: page's server [{}]"},

    // Accuracy.
    {"", "--error", kHowClose, "E|P%", "largest error of the value, or in % of the range [0]"},
    {"", "--error-relative", kHowClose, "R", "the same, as a fraction of the data's range"},
    {"", "--distance", kHowClose, "D[UNIT]", "largest distance to the full surface: 0.5mm, 1voxel"},
    {"", "--triangles", kHowClose, "N", "at most so many triangles, as close as they can be"},
    {"", "--by", kHowClose, "distance|error", "what --triangles makes small [distance]"},
    {"", "--effort", kHowClose, "none|fast|best", "how far to simplify at the same error [best]"},
    {"", "--indicator", kHowClose, "NAME", "[deviation], plus (looser) or estimate (no bound)"},
    {"", "--stop", kHowClose, "FIELD", "in place of an error: refine while this field is not"},
    {"", "--threshold", kHowClose, "T", "... below this threshold, in the field's units [0]"},
    {"", "--threshold-relative", kHowClose, "T", "... below this fraction of its largest value"},
    {"", "--focus", kHowClose, "X,Y,Z[,X1,Y1,Z1]", "the error holds at this point, or in this box"},
    {"", "--falloff", kHowClose, "F", "the error at distance d is multiplied by 1 + F d"},
    {"", "--camera", kHowClose, "X,Y,Z", "stop where a viewer at this place sees no difference"},
    {"", "--pixels", kHowClose, "N", "with --camera: the smallest visible size, pixels [1]"},
    {"", "--fov", kHowClose, "DEG", "with --camera: vertical field of view, degrees [40]"},
    {"", "--height", kHowClose, "PIXELS", "with --camera: height of the picture, pixels [1080]"},
    {"", "--bound", kHowClose, "FIELD", "field that rules out empty cells [the tightest]"},
    {"", "--keep-analysis", kHowClose, "[=FOLDER]", "keep what makes the next distance fast"},

    // Regions and parts.
    {"", "--box", kWhichParts, "x0,y0,z0,x1,y1,z1", "only what is inside this box"},
    {"", "--components", kWhichParts, "N|all", "keep the N largest (or: largest); all: count them"},
    {"", "--min-component", kWhichParts, "N", "drop pieces of fewer triangles"},
    {"", "--min-volume", kWhichParts, "V", "drop closed pieces of less volume, in world units"},
    {"", "--close", kWhichParts, "[=below|above]", "close it at the volume's faces: outside is [below]"},
    {"", "--view", kWhichParts, "X,Y,Z", "leave out what faces away from this view direction"},
    {"", "--cull-by", kWhichParts, "FIELD", "with --view: normal_turn_plus or grad_linf_plus"},

    // Output.
    {"extract", "--output", kWritten, "MESH", ".ply .stl .obj .vtp .vtkhdf .glb .3mf"},
    {"slice", "--output", kWritten, "OUT", ".png; mesh: .ply .vtp .vtkhdf .glb"},
    {"preprocess", "--output", kWritten, "STORE", "the store, as scan.isonest"},
    {"export make-volume", "--output", kWritten, "FILE", ".h5 .nrrd .nii .vti .npy .mha .raw"},
    {"picture", "--output", kWritten, "OUT.png", "the picture; --turntable: OUT_000.png ..."},
    {"smooth", "--output", kWritten, "OUT", ".h5 .nrrd .raw; of a plane .png too"},
    {"info", "--output", kWritten, "PLOT", "the histogram as a plot, .png or .svg"},
    {"study", "--out", kWritten, "FOLDER", "the folder for the table and the plots"},
    {"publish", "--output", kWritten, "FOLDER", "the folder to write"},
    {"extract", "--normals", kWritten, "", "vertex normals, from the gradient of the data"},
    {"slice", "--normals", kWritten, "", "vertex normals: the plane's"},
    {"", "--vertex-values", kWritten, "STORE", "vertex values from a store of the same lattice"},
    {"", "--vertex-error", kWritten, "FIELD", "how far vertices may be off, by this field"},
    {"", "--space", kWritten, "AXES", "patient axes: ras, lps, as-stored [ras where known]"},
    {"", "--format", kWritten, "NAME", "with --labels: ply, ... or neuroglancer[-multilod]"},
    {"", "--over", kWritten, "zarr|precomputed", "the volume that Neuroglancer shows [zarr]"},
    {"", "--volume-interval", kWritten, "", "with --close: bounds on the full solid's volume"},
    {"", "--quality", kWritten, "", "report the angles of the triangles"},
    {"smooth", "--grid", kWritten, "FILE", "grid of the result: 1 at its nodes; of a plane .png"},
    {"", "--snapshots", kWritten, "N,N,...", "write these steps too, as OUT-N"},
    {"", "--chunk", kWritten, "N", "nodes per axis of a chunk, a power of two [{}]"},
    {"", "--compression", kWritten, "LEVEL", "zstd level, 1 to 19 [{}]"},
    {"", "--exact", kWritten, "", "indicators in full precision, not in 16 bits"},
    {"", "--link", kWritten, "URL", "where a store is, in place of a copy in the folder"},
    {"", "--hard-link", kWritten, "", "link the stores, in place of copies"},
    {"", "--title", kWritten, "TEXT", "above the picture; once, or once for each store"},
    {"", "--description", kWritten, "TEXT", "likewise; an empty line begins a paragraph"},
    {"", "--license", kWritten, "TEXT", "likewise"},
    {"", "--force", kWritten, "", "replace what is there"},
    {"publish", "--force", kWritten, "", "replace a folder that isonest publish made"},
    {"", "--resume", kWritten, "", "continue a killed run, or keep an interrupted one"},
    {"", "--scratch", kLimits, "FOLDER", "temporary files of a rank [the store's folder]"},

    // Pictures.
    {"", "--size", kPicture, "WxH", "pixels [{}]"},
    {"", "--colors", kPicture, "NAME", "viridis, gray, hot, coolwarm, ...; NAME_r: reversed"},
    {"", "--plain", kPicture, "", "without axes, scale bar and colour bar"},
    {"", "--range", kPicture, "LOW,HIGH", "values of the first and last colour [all]"},
    {"slice", "--grid", kPicture, "", "draw the edges of the triangles"},
    {"picture", "--view", kPicture, "VIEW", "front, back, left, right, top, bottom, iso, X,Y,Z"},
    {"", "--turntable", kPicture, "N", "N pictures from all around"},
    {"", "--wireframe", kPicture, "", "draw the edges of the triangles too"},
    {"", "--flat", kPicture, "", "one shade per triangle"},
    {"", "--color-by", kPicture, "NAME", "vertex property for the colours, or none [value]"},
    {"", "--color", kPicture, "R,G,B", "of the surface, each 0 to 255 [110,156,204]"},

    // Reading a volume.
    {"", "--dataset", kReading, "PATH", "the array, in a file of several (HDF5, Zarr, .npz)"},
    {"", "--series", kReading, "UID", "the DICOM series, if there are several"},
    {"", "--index", kReading, "AT", "of time steps or channels: 5,:,:,: or time=5,c=0"},
    {"", "--crop", kReading, "X0:X1,Y0:Y1,Z0:Z1", "nodes from X0 to X1 - 1; -5: from the end"},
    {"", "--every", kReading, "N|X,Y[,Z]", "each N-th node only"},
    {"", "--dims", kReading, "X,Y[,Z]", "raw: nodes per axis, fastest first"},
    {"", "--type", kReading, "T", "raw: uint8, int16, float32, ... or u1, i2, >f4"},
    {"", "--endian", kReading, "END", "raw: big or little [little]"},
    {"", "--offset", kReading, "BYTES", "raw: bytes to skip [0]"},
    {"", "--spacing", kReading, "X,Y[,Z]", "distance of the nodes, in place of the file's"},
    {"", "--origin", kReading, "X,Y[,Z]", "position of the first node, in place of the file's"},
    {"", "--unit", kReading, "U", "unit of length, in place of the file's: mm, um, ..."},
    {"", "--frame", kReading, "ras|lps", "patient axes of the world, in place of the file's"},
    {"", "--missing", kReading, "V", "this value means missing data, as NaN does"},
    {"preprocess info check", "--labels", kReading, "", "values are labels: whole numbers, with names"},
    {"", "--label-names", kReading, "FILE", "names and colours (FreeSurfer, Slicer, ITK-SNAP)"},
    {"", "--keep-store", kReading, "STORE", "keep the store that is made of a volume"},
    {"", "--header", kNetwork, "HEADER", "sent with each request: 'Name: value', or @FILE"},
    {"", "--cache", kNetwork, "FOLDER[:SIZE]", "keep what was fetched here, up to SIZE [1G]"},

    // The server of `view`.
    {"", "--port", kServer, "P", "to listen on; 0 = any that is free [{}]"},
    {"", "--address", kServer, "IP", "network interface; 0.0.0.0 = all [127.0.0.1]"},
    {"", "--token", kServer, "", "ask for a token on this machine, too"},
    {"", "--open", kServer, "", "open the page in the browser"},

    // Resources.
    {"", "--memory", kLimits, "SIZE", "heap to stay within [{}]"},
    {"", "--threads", kLimits, "N", "threads; 0 = one per core [0]"},
    {"", "--json", kGeneral, "", "print one JSON object in place of text"},
    {"", "--quiet", kGeneral, "", "no progress, and no text where all is well"},
    {"", "--help", kGeneral, "", "print this help"},
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

}  // namespace isonest::detail::cli
