// A pipeline that owns its geometry: it makes a mesh, lets it ripple and turn in front of the camera for eight frames, and renders each in
// this process. One frame is cancelled on purpose. Given the helmholtz program, it has that render the same frames from files, and compares.
//
//     turntable [OUTPUT-DIRECTORY [HELMHOLTZ [SIZE PASSES]]]
#include <helmholtz.hpp>

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <iostream>
#include <iterator>
#include <numbers>
#include <sstream>

namespace {

constexpr int frames = 8;

/// A torus whose tube ripples.
struct torus {
    std::vector<float> positions;
    std::vector<std::uint32_t> indices;

    explicit torus(double phase) {
        constexpr std::uint32_t around = 96, across = 32;
        const double step = 2 * std::numbers::pi;
        for (std::uint32_t i = 0; i < around; ++i) {
            for (std::uint32_t j = 0; j < across; ++j) {
                const double u = step * i / around, v = step * j / across;
                const double tube = 0.3 + 0.06 * std::sin(8 * u + phase), ring = 0.7 + tube * std::cos(v);
                for (double x : {ring * std::cos(u), tube * std::sin(v), -ring * std::sin(u)})
                    positions.push_back(static_cast<float>(x));
                const std::uint32_t a = i * across + j, b = i * across + (j + 1) % across;
                const std::uint32_t next = across, all = around * across;
                for (std::uint32_t k : {a, (a + next) % all, (b + next) % all, a, (b + next) % all, b})
                    indices.push_back(k);
            }
        }
    }

    helmholtz::mesh mesh() const { return {"torus.ply", positions, indices}; }

    /// For the program, which reads files.
    void write(const std::string &path) const {
        std::ofstream file(path, std::ios::binary);
        file << "ply\nformat binary_little_endian 1.0\nelement vertex " << positions.size() / 3
             << "\nproperty float x\nproperty float y\nproperty float z\nelement face " << indices.size() / 3
             << "\nproperty list uchar uint vertex_indices\nend_header\n";
        file.write(reinterpret_cast<const char *>(positions.data()), std::streamsize(positions.size() * 4));
        for (std::size_t i = 0; i < indices.size(); i += 3) {
            file.put(3);
            file.write(reinterpret_cast<const char *>(&indices[i]), 12);
        }
    }
};

std::string sensor(int frame, int size) {
    const double angle = 2 * std::numbers::pi * frame / frames;
    std::ostringstream xml;
    xml.precision(17);
    xml << "<sensor type='perspective'><transform name='to_world'><lookat origin='" << 3 * std::sin(angle) << ", 2, "
        << 3 * std::cos(angle) << "' target='0, 0, 0' up='0, 1, 0'/></transform><film type='hdrfilm'><integer name='width' value='"
        << size << "'/><integer name='height' value='" << size
        << "'/><string name='component_format' value='float32'/></film></sensor>";
    return xml.str();
}

std::string scene_text(int frame, int size) {
    return "<scene version='3.0.0'><integrator type='path'><integer name='max_depth' value='6'/></integrator>" +
           sensor(frame, size) +
           "<bsdf type='roughconductor' id='metal'><string name='material' value='Au'/><float name='alpha' value='0.2'/></bsdf>"
           "<shape type='ply' id='torus'><string name='filename' value='torus.ply'/><ref id='metal'/></shape>"
           "<shape type='rectangle' id='floor'><transform name='to_world'><scale value='4'/><rotate x='1' angle='-90'/>"
           "<translate y='-0.4'/></transform></shape>"
           "<shape type='sphere'><point name='center' x='1' y='3' z='1'/><float name='radius' value='0.5'/>"
           "<emitter type='area'><rgb name='radiance' value='20'/></emitter></shape>"
           "<emitter type='constant'><rgb name='radiance' value='0.2'/></emitter></scene>";
}

/// The part of an OpenEXR file after header and offsets: the pixels, as they were compressed.
std::string pixels_of(const std::string &path) {
    std::ifstream file(path, std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(file), {}};
    std::size_t at = 8;  // Magic number and version.
    while (at < bytes.size() && bytes[at] != 0) {
        at = bytes.find('\0', at) + 1;            // The name of an attribute,
        at = bytes.find('\0', at) + 1;            // its type,
        std::uint32_t size = 0;
        if (at + 4 > bytes.size()) break;
        std::memcpy(&size, &bytes[at], 4);        // and its size.
        at += 4 + size;
    }
    std::uint64_t first = 0;
    if (at + 9 > bytes.size()) throw std::runtime_error(path + " is not an OpenEXR file");
    std::memcpy(&first, &bytes[at + 1], 8);
    return bytes.substr(first);
}

/// Renders a frame, with its progress.
bool render(const helmholtz::render &render, int frame) {
    const bool finished = render.wait();
    const helmholtz_progress done = render.poll();
    std::cout << "frame " << frame << ": " << done.passes_done << " of " << done.passes_total << " passes, " << done.rays
              << " rays, " << done.dropped << " dropped" << (finished ? "" : ", cancelled") << '\n';
    return finished;
}

int run(const std::string &folder, const std::string &program, int size, std::uint32_t passes) {
    const torus start(0);
    helmholtz::scene scene = helmholtz::scene::parse(scene_text(0, size), {.meshes = {start.mesh()}});
    std::cout << scene.messages() << scene.describe().primitive_count << " triangles and spheres\n";
    for (int frame = 0; frame < frames; ++frame) {
        const torus now(0.7 * frame);
        scene.edit("<scene version='3.0.0'>" + sensor(frame, size) + "</scene>");
        scene.set_mesh("torus", now.mesh());
        if (frame == 3) {
            // Someone changes their mind after the first pass. What there is can be looked at.
            const auto impatient = [](const helmholtz_progress &progress) { return progress.passes_done < 1; };
            const helmholtz::render cancelled = scene.start({.pass_count = passes + 1, .progress = impatient});
            std::vector<float> rgba(std::size_t(size) * size * 4);
            if (render(cancelled, frame)) throw std::runtime_error("the frame was not cancelled");
            cancelled.read("R,G,B,A", rgba);
            if (rgba[3] != 1) throw std::runtime_error("there is no picture of the cancelled frame");
        }
        std::uint32_t seen = 0;
        const auto progress = [&seen](const helmholtz_progress &progress) { return ++seen == progress.passes_done; };
        const helmholtz::render finished = scene.start({.pass_count = passes, .progress = progress});
        if (!render(finished, frame)) throw std::runtime_error("the frame is not finished");

        const std::string name = folder + "/frame" + std::to_string(frame);
        finished.save(name + ".exr");
        std::vector<float> rgb(std::size_t(size) * size * 3);
        finished.read("R,G,B", rgb);
        double sum = 0;
        for (float value : rgb) sum += value;
        if (!(sum > 0)) throw std::runtime_error("the picture is black");

        if (program.empty()) continue;
        now.write(folder + "/torus.ply");
        std::ofstream(folder + "/frame.xml") << scene_text(frame, size);
        const std::string command = "'" + program + "' render '" + folder + "/frame.xml' --quiet --spp " +
                                    std::to_string(passes) + " -o '" + name + "-program.exr'";
        if (std::system(command.c_str()) != 0) throw std::runtime_error("the program failed");
        if (pixels_of(name + ".exr") != pixels_of(name + "-program.exr"))
            throw std::runtime_error(name + " differs from what the program renders");
        std::cout << "  the same bits as " << program << " renders\n";
    }
    return EXIT_SUCCESS;
}

}  // namespace

int main(int argc, char **argv) {
    try {
        const auto argument = [&](int i, const char *otherwise) { return std::string(argc > i ? argv[i] : otherwise); };
        return run(argument(1, "."), argument(2, ""), std::stoi(argument(3, "96")),
                   std::uint32_t(std::stoul(argument(4, "8"))));
    } catch (const std::exception &error) {
        std::cerr << "error: " << error.what() << '\n';
        return EXIT_FAILURE;
    }
}
