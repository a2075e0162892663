// Helmholtz for C++20: helmholtz.h with owners instead of handles, exceptions instead of statuses, and spans instead of pointers.
//
// Header-only: link against the C library. Everything said in helmholtz.h holds here too.
#ifndef HELMHOLTZ_HPP
#define HELMHOLTZ_HPP

#include <cstdint>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "helmholtz.h"

namespace helmholtz {

/// A call that failed; what() is helmholtz_last_error().
class error : public std::runtime_error {
public:
    explicit error(helmholtz_status status) : std::runtime_error(helmholtz_last_error()), status_(status) {}
    helmholtz_status status() const noexcept { return status_; }

private:
    helmholtz_status status_;
};

/// Throws unless a call went well.
inline void check(helmholtz_status status) {
    if (status != HELMHOLTZ_OK) throw error(status);
}

/// Triangles in the caller's memory, tightly packed. They are copied when they are handed over.
struct mesh {
    std::string name;
    std::span<const float> positions;        // three per vertex
    std::span<const std::uint32_t> indices;  // three per triangle
    std::span<const float> normals = {};     // three per vertex, or none
    std::span<const float> uvs = {};         // two per vertex, or none

    helmholtz_mesh c() const {
        const std::size_t vertices = positions.size() / 3;
        if (positions.size() % 3 || indices.size() % 3 || (!normals.empty() && normals.size() != 3 * vertices) ||
            (!uvs.empty() && uvs.size() != 2 * vertices))
            throw std::invalid_argument("helmholtz::mesh: the sizes of the buffers do not go together");
        helmholtz_mesh m{};
        m.size = sizeof m;
        m.name = name.c_str();
        m.vertex_count = vertices;
        m.positions = positions.data();
        m.normals = normals.empty() ? nullptr : normals.data();
        m.uvs = uvs.empty() ? nullptr : uvs.data();
        m.triangle_count = indices.size() / 3;
        m.indices = indices.data();
        return m;
    }
};

/// How a scene is loaded; see helmholtz_load_options.
struct load_options {
    std::vector<mesh> meshes = {};
    std::vector<std::pair<std::string, std::string>> defines = {};
    std::string directory = {};
    bool lenient = false;
    std::uint32_t threads = 0;
};

/// What is rendered; see helmholtz_render_options.
struct render_options {
    std::string integrator = {};
    std::string aovs = {};
    std::uint64_t seed = 0;
    std::uint32_t first_pass = 0;
    std::uint32_t pass_count = 0;
    double seconds = 0;
    std::uint32_t threads = 0;
    /// Called after each pass on a thread of the render; true goes on, false cancels. What it throws cancels the render and comes out of wait().
    std::function<bool(const helmholtz_progress &)> progress = {};
};

/// A render, running or finished. Its destructor cancels it and waits for the end of its pass.
class render {
public:
    render(helmholtz_scene scene, const render_options &options) : callback_(std::make_unique<callback>()) {
        callback_->function = options.progress;
        helmholtz_render_options c{};
        c.size = sizeof c;
        c.integrator = options.integrator.empty() ? nullptr : options.integrator.c_str();
        c.aovs = options.aovs.empty() ? nullptr : options.aovs.c_str();
        c.seed = options.seed;
        c.first_pass = options.first_pass;
        c.pass_count = options.pass_count;
        c.seconds = options.seconds;
        c.threads = options.threads;
        if (options.progress) {
            c.progress = &callback::call;
            c.user = callback_.get();
        }
        check(helmholtz_render_start(scene, &c, &handle_));
    }
    render(render &&other) noexcept
        : callback_(std::move(other.callback_)), handle_(std::exchange(other.handle_, helmholtz_render{})) {}
    render &operator=(render &&other) noexcept {
        std::swap(callback_, other.callback_);
        std::swap(handle_, other.handle_);
        return *this;
    }
    ~render() { helmholtz_render_free(handle_); }

    /// Waits for the end. True if all passes were made, false if it was cancelled.
    bool wait() const {
        const helmholtz_status status = helmholtz_render_wait(handle_);
        if (status != HELMHOLTZ_OK && status != HELMHOLTZ_CANCELLED) throw error(status);
        const std::lock_guard lock(callback_->mutex);
        if (callback_->thrown) std::rethrow_exception(std::exchange(callback_->thrown, nullptr));
        return status == HELMHOLTZ_OK;
    }
    void cancel() const { check(helmholtz_render_cancel(handle_)); }
    helmholtz_progress poll() const {
        helmholtz_progress progress{};
        progress.size = sizeof progress;
        check(helmholtz_render_poll(handle_, &progress));
        return progress;
    }
    /// Copies channels, such as "R,G,B", as they are at the moment; strides in floats, 0 for no gaps.
    void read(const std::string &channels, std::span<float> data, std::size_t pixel_stride = 0,
              std::size_t row_stride = 0) const {
        check(helmholtz_render_read(handle_, channels.c_str(), data.data(), data.size(), pixel_stride, row_stride));
    }
    void read(const std::string &channel, std::span<std::uint32_t> data, std::size_t pixel_stride = 0,
              std::size_t row_stride = 0) const {
        check(helmholtz_render_read_integers(handle_, channel.c_str(), data.data(), data.size(), pixel_stride,
                                             row_stride));
    }
    /// Writes an .exr or .png file.
    void save(const std::string &path) const { check(helmholtz_render_save(handle_, path.c_str())); }
    helmholtz_render handle() const noexcept { return handle_; }

private:
    /// On the heap, where it stays when the render is moved.
    struct callback {
        std::function<bool(const helmholtz_progress &)> function;
        std::mutex mutex;
        std::exception_ptr thrown;

        static int call(const helmholtz_progress *progress, void *user) noexcept {
            auto &self = *static_cast<callback *>(user);
            try {
                return self.function(*progress) ? 0 : 1;
            } catch (...) {
                const std::lock_guard lock(self.mutex);
                self.thrown = std::current_exception();
                return 1;
            }
        }
    };
    std::unique_ptr<callback> callback_;
    helmholtz_render handle_{};
};

/// A scene.
class scene {
public:
    /// Loads a Mitsuba scene (.xml) or a mesh (.obj, .ply).
    static scene load(const std::string &path, const load_options &options = {}) {
        scene result;
        const with with(options);
        check(helmholtz_scene_load(path.c_str(), &with.c, &result.handle_));
        return result;
    }
    /// Loads a text of Mitsuba XML.
    static scene parse(const std::string &xml, const load_options &options = {}) {
        scene result;
        const with with(options);
        check(helmholtz_scene_parse(xml.c_str(), &with.c, &result.handle_));
        return result;
    }
    scene(scene &&other) noexcept : handle_(std::exchange(other.handle_, helmholtz_scene{})) {}
    scene &operator=(scene &&other) noexcept {
        std::swap(handle_, other.handle_);
        return *this;
    }
    ~scene() { helmholtz_scene_free(handle_); }

    /// Replaces sensor, integrator and BSDFs, and adds shapes and lights; see helmholtz_scene_edit.
    void edit(const std::string &xml, const load_options &options = {}) {
        const with with(options);
        check(helmholtz_scene_edit(handle_, xml.c_str(), &with.c));
    }
    /// Gives a shape other vertices; see helmholtz_scene_set_mesh.
    void set_mesh(const std::string &shape, const mesh &mesh) {
        const helmholtz_mesh c = mesh.c();
        check(helmholtz_scene_set_mesh(handle_, shape.c_str(), &c));
    }
    void set_backend(const std::string &backend, helmholtz_update update = HELMHOLTZ_REBUILD) {
        check(helmholtz_scene_set_backend(handle_, backend.empty() ? nullptr : backend.c_str(), update));
    }
    void commit() { check(helmholtz_scene_commit(handle_)); }
    helmholtz_scene_info describe() const {
        helmholtz_scene_info info{};
        info.size = sizeof info;
        check(helmholtz_scene_describe(handle_, &info));
        return info;
    }
    std::uint32_t find_shape(const std::string &id) const {
        std::uint32_t number = 0;
        check(helmholtz_scene_find_shape(handle_, id.c_str(), &number));
        return number;
    }
    std::string messages() const {
        std::size_t length = 0;
        check(helmholtz_scene_messages(handle_, nullptr, 0, &length));
        std::string text(length, '\0');
        check(helmholtz_scene_messages(handle_, text.data(), text.size(), nullptr));
        text.resize(length - 1);
        return text;
    }
    void intersect(std::span<const helmholtz_ray> rays, std::span<helmholtz_hit> hits) const {
        if (hits.size() < rays.size()) throw std::invalid_argument("helmholtz::scene: fewer hits than rays");
        check(helmholtz_intersect(handle_, rays.data(), hits.data(), rays.size()));
    }
    void occluded(std::span<const helmholtz_ray> rays, std::span<std::uint8_t> occluded) const {
        if (occluded.size() < rays.size()) throw std::invalid_argument("helmholtz::scene: fewer answers than rays");
        check(helmholtz_occluded(handle_, rays.data(), occluded.data(), rays.size()));
    }
    /// Starts to render, and returns at once.
    render start(const render_options &options = {}) const { return render(handle_, options); }
    helmholtz_scene handle() const noexcept { return handle_; }

private:
    scene() = default;

    /// Options as C has them, and what they point to.
    struct with {
        explicit with(const load_options &options) {
            for (const mesh &m : options.meshes) meshes.push_back(m.c());
            for (const auto &[name, value] : options.defines) {
                defines.push_back(name.c_str());
                defines.push_back(value.c_str());
            }
            c.size = sizeof c;
            c.meshes = meshes.data();
            c.mesh_count = meshes.size();
            c.defines = defines.data();
            c.define_count = options.defines.size();
            c.directory = options.directory.empty() ? nullptr : options.directory.c_str();
            c.lenient = options.lenient;
            c.threads = options.threads;
        }
        std::vector<helmholtz_mesh> meshes;
        std::vector<const char *> defines;
        helmholtz_load_options c{};
    };
    helmholtz_scene handle_{};
};

}  // namespace helmholtz

#endif
