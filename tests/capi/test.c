/* Calls every function of helmholtz.h with good and with bad arguments. C99 or later, and C++. Exit code 0 if all is as documented. */
#include <helmholtz.h>

#include <math.h>
#include <stdio.h>
#include <string.h>

static int failures = 0;
static int checks = 0;

static void expect(helmholtz_status expected, helmholtz_status found, const char *call, int line) {
    ++checks;
    if (found != expected) {
        ++failures;
        fprintf(stderr, "line %d: %s: %s instead of %s (%s)\n", line, call, helmholtz_status_name(found),
                helmholtz_status_name(expected), helmholtz_last_error());
    }
}

static void expect_true(int is_true, const char *what, int line) {
    ++checks;
    if (!is_true) {
        ++failures;
        fprintf(stderr, "line %d: not so: %s (%s)\n", line, what, helmholtz_last_error());
    }
}

#define OK(call) expect(HELMHOLTZ_OK, (call), #call, __LINE__)
#define IS(status, call) expect((status), (call), #call, __LINE__)
#define ARGUMENT(call) expect(HELMHOLTZ_INVALID_ARGUMENT, (call), #call, __LINE__)
#define HANDLE(call) expect(HELMHOLTZ_INVALID_HANDLE, (call), #call, __LINE__)
#define TRUE(what) expect_true((what) ? 1 : 0, #what, __LINE__)
/* To within some roundings. */
#define NEAR(a, b) expect_true(fabs((double)(a) - (double)(b)) < 1e-6 * fabs((double)(b)), #a " is about " #b, __LINE__)
#define SAYS(text) expect_true(strstr(helmholtz_last_error(), (text)) != NULL, "the message has " text, __LINE__)

#define SIZE 16

static const char *const xml =
    "<scene version='3.0.0'><integrator type='path'><integer name='max_depth' value='3'/></integrator>"
    "<sensor type='perspective'><float name='fov' value='60'/><transform name='to_world'><lookat origin='0,0,3' target='0,0,0' up='0,1,0'/></transform>"
    "<film type='hdrfilm'><integer name='width' value='$size'/><integer name='height' value='$size'/></film></sensor>"
    "<bsdf type='diffuse' id='grey'/>"
    "<shape type='ply' id='quad'><string name='filename' value='quad.ply'/><ref id='grey'/></shape>"
    "<emitter type='constant'/></scene>";

/* Two triangles, in rows that have more in them than positions. */
static const float vertices[4][5] = {
    {-1, -1, 0, 0, 0}, {1, -1, 0, 1, 0}, {1, 1, 0, 1, 1}, {-1, 1, 0, 0, 1}};
static const unsigned indices[6] = {0, 1, 2, 0, 2, 3};

static helmholtz_mesh quad(void) {
    helmholtz_mesh mesh;
    memset(&mesh, 0, sizeof mesh);
    mesh.size = sizeof mesh;
    mesh.name = "quad.ply";
    mesh.vertex_count = 4;
    mesh.positions = vertices[0];
    mesh.position_stride = sizeof vertices[0];
    mesh.uvs = &vertices[0][3];
    mesh.uv_stride = sizeof vertices[0];
    mesh.triangle_count = 2;
    mesh.indices = indices;
    return mesh;
}

static helmholtz_scene make_scene(void) {
    static const char *const defines[2] = {"size", "16"};
    helmholtz_scene scene = {0};
    helmholtz_mesh mesh = quad();
    helmholtz_load_options options;
    memset(&options, 0, sizeof options);
    options.size = sizeof options;
    options.meshes = &mesh;
    options.mesh_count = 1;
    options.defines = defines;
    options.define_count = 1;
    options.threads = 2;
    OK(helmholtz_scene_parse(xml, &options, &scene));
    return scene;
}

static void loading(const char *mesh_file) {
    helmholtz_scene scene = {0};
    helmholtz_load_options options;
    helmholtz_mesh meshes[2];
    const char *defines[2] = {"size", NULL};
    struct {
        helmholtz_load_options options;
        char more[8];
    } later;

    OK(helmholtz_scene_load(mesh_file, NULL, &scene));
    OK(helmholtz_scene_free(scene));
    HANDLE(helmholtz_scene_free(scene));
    ARGUMENT(helmholtz_scene_load(NULL, NULL, &scene));
    ARGUMENT(helmholtz_scene_load(mesh_file, NULL, NULL));
    ARGUMENT(helmholtz_scene_load("\xff\xfe.xml", NULL, &scene));
    IS(HELMHOLTZ_INVALID_SCENE, helmholtz_scene_load("nowhere.xml", NULL, &scene));
    SAYS("nowhere.xml");
    IS(HELMHOLTZ_INVALID_SCENE, helmholtz_scene_load("scene.txt", NULL, &scene));

    ARGUMENT(helmholtz_scene_parse(NULL, NULL, &scene));
    ARGUMENT(helmholtz_scene_parse(xml, NULL, NULL));
    IS(HELMHOLTZ_INVALID_SCENE, helmholtz_scene_parse("", NULL, &scene));
    IS(HELMHOLTZ_INVALID_SCENE, helmholtz_scene_parse(xml, NULL, &scene));
    SAYS("$size");

    memset(&options, 0, sizeof options);
    ARGUMENT(helmholtz_scene_parse(xml, &options, &scene));
    SAYS("sizeof");
    options.size = (size_t)-1;
    ARGUMENT(helmholtz_scene_parse(xml, &options, &scene));
    options.size = sizeof options;
    options.threads = 1000000;
    ARGUMENT(helmholtz_scene_parse(xml, &options, &scene));
    options.threads = 1;
    options.define_count = 1;
    ARGUMENT(helmholtz_scene_parse(xml, &options, &scene));
    options.defines = defines;
    ARGUMENT(helmholtz_scene_parse(xml, &options, &scene));
    options.define_count = (size_t)-1;
    ARGUMENT(helmholtz_scene_parse(xml, &options, &scene));
    options.define_count = 1;
    defines[1] = "16";
    options.mesh_count = 1;
    ARGUMENT(helmholtz_scene_parse(xml, &options, &scene));
    meshes[0] = meshes[1] = quad();
    options.meshes = meshes;
    options.mesh_count = 2;
    ARGUMENT(helmholtz_scene_parse(xml, &options, &scene));
    SAYS("two meshes");
    options.mesh_count = 1;
    meshes[0].name = NULL;
    ARGUMENT(helmholtz_scene_parse(xml, &options, &scene));
    meshes[0] = quad();
    meshes[0].positions = NULL;
    ARGUMENT(helmholtz_scene_parse(xml, &options, &scene));
    meshes[0] = quad();
    meshes[0].position_stride = 8;
    ARGUMENT(helmholtz_scene_parse(xml, &options, &scene));
    meshes[0] = quad();
    meshes[0].vertex_count = (size_t)-1;
    ARGUMENT(helmholtz_scene_parse(xml, &options, &scene));
    meshes[0] = quad();
    meshes[0].vertex_count = 3;
    IS(HELMHOLTZ_INVALID_SCENE, helmholtz_scene_parse(xml, &options, &scene));
    SAYS("uses vertex 3");
    TRUE(scene.id != 0); /* That of the first, which is freed: failures leave what they were to fill as it was. */

    /* A program of a later version, whose struct is larger. */
    memset(&later, 0, sizeof later);
    meshes[0] = quad();
    later.options = options;
    later.options.size = sizeof later;
    OK(helmholtz_scene_parse(xml, &later.options, &scene));
    OK(helmholtz_scene_free(scene));
    later.more[3] = 1;
    ARGUMENT(helmholtz_scene_parse(xml, &later.options, &scene));
    SAYS("does not have");

    /* What is not supported is replaced if one likes, and told. */
    options.define_count = 0;
    IS(HELMHOLTZ_INVALID_SCENE,
       helmholtz_scene_parse("<scene version='3.0.0'><bsdf type='plaster'/></scene>", &options, &scene));
    options.lenient = 1;
    options.directory = "\xff";
    ARGUMENT(helmholtz_scene_parse("<scene version='3.0.0'><bsdf type='plaster'/></scene>", &options, &scene));
    options.directory = "/";
    OK(helmholtz_scene_parse("<scene version='3.0.0'><bsdf type='plaster'/></scene>", &options, &scene));
    {
        char text[512], few[8];
        size_t length = 0;
        OK(helmholtz_scene_messages(scene, text, sizeof text, &length));
        TRUE(strstr(text, "plaster") != NULL && length == strlen(text) + 1);
        OK(helmholtz_scene_messages(scene, NULL, 0, &length));
        OK(helmholtz_scene_messages(scene, few, sizeof few, NULL));
        TRUE(strlen(few) == sizeof few - 1 && strncmp(few, text, sizeof few - 1) == 0);
        ARGUMENT(helmholtz_scene_messages(scene, NULL, 3, &length));
    }
    OK(helmholtz_scene_free(scene));
    HANDLE(helmholtz_scene_messages(scene, NULL, 0, NULL));
}

static float distance_to(helmholtz_scene scene) {
    helmholtz_ray ray = {{0.25f, 0.5f, 3}, 0, {0, 0, -1}, INFINITY};
    helmholtz_hit hit;
    memset(&hit, 0, sizeof hit);
    OK(helmholtz_intersect(scene, &ray, &hit, 1));
    return hit.t;
}

static void editing(void) {
    helmholtz_scene scene = make_scene(), none = {0};
    helmholtz_mesh mesh = quad();
    helmholtz_scene_info info;
    unsigned number = 7;
    float moved[4][5];
    int i;

    memset(&info, 0, sizeof info);
    ARGUMENT(helmholtz_scene_describe(scene, &info));
    info.size = sizeof info;
    OK(helmholtz_scene_describe(scene, &info));
    TRUE(info.width == SIZE && info.height == SIZE && info.shape_count == 1 && info.primitive_count == 2);
    TRUE(info.bounds_min[0] == -1 && info.bounds_max[1] == 1 && info.size == sizeof info && info.pass_count == 4);
    ARGUMENT(helmholtz_scene_describe(scene, NULL));
    HANDLE(helmholtz_scene_describe(none, &info));

    OK(helmholtz_scene_find_shape(scene, "quad", &number));
    TRUE(number == 0);
    ARGUMENT(helmholtz_scene_find_shape(scene, "cube", &number));
    ARGUMENT(helmholtz_scene_find_shape(scene, NULL, &number));
    ARGUMENT(helmholtz_scene_find_shape(scene, "quad", NULL));
    HANDLE(helmholtz_scene_find_shape(none, "quad", &number));

    TRUE(info.built_primitive_count == 0);
    OK(helmholtz_scene_commit(scene));
    HANDLE(helmholtz_scene_commit(none));
    OK(helmholtz_scene_describe(scene, &info));
    TRUE(info.built_primitive_count == 2);
    NEAR(distance_to(scene), 3);

    memcpy(moved, vertices, sizeof moved);
    mesh.positions = moved[0];
    for (i = 0; i < 2; ++i) {
        int k;
        OK(helmholtz_scene_set_backend(scene, i ? "obvhs:quality=low" : NULL, HELMHOLTZ_REFIT));
        NEAR(distance_to(scene), 3 - (float)i);
        OK(helmholtz_scene_describe(scene, &info));
        TRUE(info.built_primitive_count == 2);
        for (k = 0; k < 4; ++k) moved[k][2] = 1;
        OK(helmholtz_scene_set_mesh(scene, "quad", &mesh));
        NEAR(distance_to(scene), 2);
        OK(helmholtz_scene_describe(scene, &info));
        TRUE(info.built_primitive_count == 0);
    }
    OK(helmholtz_scene_set_backend(scene, "embree", HELMHOLTZ_REBUILD));
    NEAR(distance_to(scene), 2);
    ARGUMENT(helmholtz_scene_set_backend(scene, "abacus", HELMHOLTZ_REBUILD));
    ARGUMENT(helmholtz_scene_set_backend(scene, "", HELMHOLTZ_REBUILD));
    ARGUMENT(helmholtz_scene_set_backend(scene, "embree:speed=high", HELMHOLTZ_REBUILD));
    ARGUMENT(helmholtz_scene_set_backend(scene, NULL, 17));
    HANDLE(helmholtz_scene_set_backend(none, NULL, HELMHOLTZ_REBUILD));

    ARGUMENT(helmholtz_scene_set_mesh(scene, NULL, &mesh));
    ARGUMENT(helmholtz_scene_set_mesh(scene, "quad", NULL));
    ARGUMENT(helmholtz_scene_set_mesh(scene, "cube", &mesh));
    HANDLE(helmholtz_scene_set_mesh(none, "quad", &mesh));
    moved[2][1] = NAN;
    IS(HELMHOLTZ_INVALID_SCENE, helmholtz_scene_set_mesh(scene, "quad", &mesh));
    SAYS("vertex 2");
    NEAR(distance_to(scene), 2);

    OK(helmholtz_scene_edit(scene, "<scene version='3.0.0'><bsdf type='conductor' id='grey'/><shape type='sphere' id='ball'/></scene>",
                            NULL));
    OK(helmholtz_scene_find_shape(scene, "ball", &number));
    TRUE(number == 1);
    ARGUMENT(helmholtz_scene_edit(scene, NULL, NULL));
    IS(HELMHOLTZ_INVALID_SCENE, helmholtz_scene_edit(scene, "<scene version='3.0.0'><emitter type='constant'/></scene>", NULL));
    HANDLE(helmholtz_scene_edit(none, "", NULL));

    OK(helmholtz_scene_free(scene));
    OK(helmholtz_scene_free(none));
}

static void asking(void) {
    helmholtz_scene scene = make_scene(), forged;
    helmholtz_ray rays[4];
    helmholtz_hit hits[4];
    unsigned char occluded[4] = {9, 9, 9, 9};
    int i;

    for (i = 0; i < 4; ++i) {
        static const float x[4] = {0.5f, 5, 0.5f, NAN};
        memset(&rays[i], 0, sizeof rays[i]);
        rays[i].origin[0] = x[i];
        rays[i].origin[1] = 0.25f;
        rays[i].origin[2] = 3;
        rays[i].direction[2] = -1;
        rays[i].t_max = i == 2 ? 2.5f : INFINITY;
    }
    OK(helmholtz_intersect(scene, rays, hits, 4));
    TRUE(hits[0].shape == 0 && hits[0].primitive == 0);
    NEAR(hits[0].t, 3);
    TRUE(hits[1].shape == UINT32_MAX && hits[2].shape == UINT32_MAX && hits[3].shape == UINT32_MAX);
    OK(helmholtz_occluded(scene, rays, occluded, 4));
    TRUE(occluded[0] == 1 && occluded[1] == 0 && occluded[2] == 0 && occluded[3] == 0);
    OK(helmholtz_intersect(scene, NULL, NULL, 0));
    OK(helmholtz_occluded(scene, NULL, NULL, 0));
    ARGUMENT(helmholtz_intersect(scene, NULL, hits, 1));
    ARGUMENT(helmholtz_intersect(scene, rays, NULL, 1));
    ARGUMENT(helmholtz_intersect(scene, rays, hits, (size_t)-1));
    ARGUMENT(helmholtz_intersect(scene, (const helmholtz_ray *)((const char *)rays + 1), hits, 1));
    SAYS("aligned");
    ARGUMENT(helmholtz_occluded(scene, NULL, occluded, 1));
    ARGUMENT(helmholtz_occluded(scene, rays, NULL, 1));
    forged.id = scene.id + 1;
    HANDLE(helmholtz_intersect(forged, rays, hits, 1));
    HANDLE(helmholtz_occluded(forged, rays, occluded, 1));
    OK(helmholtz_scene_free(scene));
    HANDLE(helmholtz_intersect(scene, rays, hits, 1));
}

/* What a callback sees. */
struct watch {
    helmholtz_scene scene;
    unsigned calls, cancel_after;
    /* Handle of the render itself, which main knows only after it has begun. */
    int waits_for_self;
    volatile uint64_t self;
    int errors;
    float pixels[SIZE * SIZE];
};

static int watch(const helmholtz_progress *progress, void *user) {
    struct watch *w = (struct watch *)user;
    helmholtz_render self;
    while (w->waits_for_self && !w->self) {
    }
    self.id = w->self;
    if (++w->calls != progress->passes_done || progress->finished || progress->dropped) ++w->errors;
    /* A scene that is being rendered cannot be changed, nor can a callback wait for itself. */
    if (helmholtz_scene_edit(w->scene, "<scene version='3.0.0'/>", NULL) != HELMHOLTZ_BUSY) ++w->errors;
    if (self.id && helmholtz_render_wait(self) != HELMHOLTZ_BUSY) ++w->errors;
    if (self.id && helmholtz_render_free(self) != HELMHOLTZ_BUSY) ++w->errors;
    if (self.id && helmholtz_render_read(self, "R", w->pixels, SIZE * SIZE, 0, 0) != HELMHOLTZ_OK) ++w->errors;
    return w->calls == w->cancel_after;
}

static void rendering(const char *exr, const char *png) {
    helmholtz_scene scene = make_scene(), forged;
    helmholtz_render render = {0}, none = {0}, foreign;
    helmholtz_render_options options;
    helmholtz_progress progress;
    static float pixels[SIZE * SIZE * 4], again[SIZE * SIZE * 4], wide[SIZE * (SIZE * 4 + 3)];
    static unsigned ids[SIZE * SIZE];
    struct watch w;
    size_t i;

    OK(helmholtz_render_start(scene, NULL, &render));
    OK(helmholtz_render_wait(render));
    OK(helmholtz_render_wait(render));
    OK(helmholtz_render_cancel(render));
    OK(helmholtz_render_wait(render)); /* It was finished before. */
    OK(helmholtz_render_read(render, "R,G,B,A", pixels, SIZE * SIZE * 4, 0, 0));
    TRUE(pixels[0] == 1 && pixels[3] == 1); /* The corner sees the white sky. */
    OK(helmholtz_render_free(render));
    HANDLE(helmholtz_render_wait(render));
    HANDLE(helmholtz_render_free(render));
    OK(helmholtz_render_free(none));

    memset(&options, 0, sizeof options);
    memset(&w, 0, sizeof w);
    w.scene = scene;
    ARGUMENT(helmholtz_render_start(scene, &options, &render));
    options.size = sizeof options;
    options.threads = 2;
    options.aovs = "depth, shape_id";
    options.integrator = "path:max_depth=3";
    options.progress = watch;
    options.user = &w;
    ARGUMENT(helmholtz_render_start(scene, &options, NULL));
    forged.id = 1;
    HANDLE(helmholtz_render_start(forged, &options, &render));
    OK(helmholtz_render_start(scene, &options, &render));
    OK(helmholtz_render_wait(render));
    TRUE(w.calls == 4 && w.errors == 0);
    memset(&progress, 0, sizeof progress);
    ARGUMENT(helmholtz_render_poll(render, &progress));
    ARGUMENT(helmholtz_render_poll(render, NULL));
    progress.size = sizeof progress;
    OK(helmholtz_render_poll(render, &progress));
    TRUE(progress.passes_done == 4 && progress.passes_total == 4 && progress.finished && progress.rays > 0);
    HANDLE(helmholtz_render_poll(none, &progress));

    /* The same bits, whatever the threads and the strides. */
    OK(helmholtz_render_read(render, "R,G,B,A", again, SIZE * SIZE * 4, 4, SIZE * 4));
    TRUE(memcmp(pixels, again, sizeof pixels) == 0);
    OK(helmholtz_render_read(render, "B,Z", wide, SIZE * (SIZE * 4 + 3), 4, SIZE * 4 + 3));
    TRUE(wide[SIZE * 4 + 3 + 4] == pixels[(SIZE + 1) * 4 + 2] && wide[2] == 0 && wide[3] == 0);
    TRUE(wide[8 * (SIZE * 4 + 3) + 8 * 4 + 1] > 2.9f && wide[8 * (SIZE * 4 + 3) + 8 * 4 + 1] < 3.2f);
    OK(helmholtz_render_read_integers(render, "id.shape", ids, SIZE * SIZE, 0, 0));
    TRUE(ids[0] == UINT32_MAX && ids[8 * SIZE + 8] == 0);
    ARGUMENT(helmholtz_render_read(render, "R,G,B,A", again, SIZE * SIZE * 4 - 1, 0, 0));
    ARGUMENT(helmholtz_render_read(render, "R", again, SIZE * SIZE, (size_t)-1, 0));
    ARGUMENT(helmholtz_render_read(render, "R", again, SIZE * SIZE, 0, (size_t)-1));
    ARGUMENT(helmholtz_render_read(render, "R,Q", again, SIZE * SIZE * 4, 0, 0));
    SAYS("`Q`");
    ARGUMENT(helmholtz_render_read(render, "id.shape", again, SIZE * SIZE, 0, 0));
    ARGUMENT(helmholtz_render_read(render, NULL, again, SIZE * SIZE, 0, 0));
    ARGUMENT(helmholtz_render_read(render, "R", NULL, SIZE * SIZE, 0, 0));
    HANDLE(helmholtz_render_read(none, "R", again, SIZE * SIZE, 0, 0));
    ARGUMENT(helmholtz_render_read_integers(render, "Z", ids, SIZE * SIZE, 0, 0));
    ARGUMENT(helmholtz_render_read_integers(render, NULL, ids, SIZE * SIZE, 0, 0));
    ARGUMENT(helmholtz_render_read_integers(render, "id.shape", NULL, SIZE * SIZE, 0, 0));
    ARGUMENT(helmholtz_render_read_integers(render, "id.shape", ids, 1, 0, 0));
    HANDLE(helmholtz_render_read_integers(none, "id.shape", ids, SIZE * SIZE, 0, 0));
    OK(helmholtz_render_save(render, exr));
    OK(helmholtz_render_save(render, png));
    ARGUMENT(helmholtz_render_save(render, "image.gif"));
    ARGUMENT(helmholtz_render_save(render, NULL));
    IS(HELMHOLTZ_FILE_ERROR, helmholtz_render_save(render, "/nowhere/image.exr"));
    HANDLE(helmholtz_render_save(none, exr));
    /* A handle of another kind. */
    foreign.id = scene.id;
    HANDLE(helmholtz_render_wait(foreign));
    HANDLE(helmholtz_render_cancel(foreign));
    OK(helmholtz_render_free(render));

    /* Cancelled by its callback after two of a thousand passes. */
    options.pass_count = 1000;
    w.calls = 0;
    w.cancel_after = 2;
    w.waits_for_self = 1;
    OK(helmholtz_render_start(scene, &options, &render));
    w.self = render.id;
    IS(HELMHOLTZ_CANCELLED, helmholtz_render_wait(render));
    SAYS("after 2 passes");
    TRUE(w.calls == 2 && w.errors == 0);
    OK(helmholtz_render_read(render, "R", again, SIZE * SIZE, 0, 0));
    OK(helmholtz_render_free(render));

    /* Cancelled from outside, looked at while it runs, freed while it runs. */
    memset(&w, 0, sizeof w);
    w.scene = scene;
    options.pass_count = 0;
    options.seconds = 1e6;
    OK(helmholtz_render_start(scene, &options, &render));
    IS(HELMHOLTZ_BUSY, helmholtz_scene_edit(scene, "<scene version='3.0.0'/>", NULL));
    OK(helmholtz_render_read(render, "R", again, SIZE * SIZE, 0, 0));
    OK(helmholtz_render_poll(render, &progress));
    TRUE(!progress.finished && progress.passes_total == UINT32_MAX);
    OK(helmholtz_render_cancel(render));
    IS(HELMHOLTZ_CANCELLED, helmholtz_render_wait(render));
    OK(helmholtz_render_free(render));
    OK(helmholtz_render_start(scene, &options, &render));
    OK(helmholtz_render_free(render));

    for (i = 0; i < 6; ++i) {
        helmholtz_render_options bad;
        memset(&bad, 0, sizeof bad);
        bad.size = sizeof bad;
        if (i == 0) bad.integrator = "guess";
        if (i == 1) bad.integrator = "path:max_depth=-7";
        if (i == 2) bad.aovs = "depht";
        if (i == 3) bad.seconds = NAN;
        if (i == 4) bad.threads = 1u << 30;
        if (i == 5) bad.first_pass = UINT32_MAX;
        ARGUMENT(helmholtz_render_start(scene, &bad, &render));
    }
    /* A scene may go while it is rendered. */
    options.seconds = 0;
    options.progress = NULL;
    OK(helmholtz_render_start(scene, &options, &render));
    OK(helmholtz_scene_free(scene));
    OK(helmholtz_render_wait(render));
    OK(helmholtz_render_read(render, "R,G,B,A", again, SIZE * SIZE * 4, 0, 0));
    TRUE(memcmp(pixels, again, sizeof pixels) == 0);
    OK(helmholtz_render_free(render));
}

int main(int argc, char **argv) {
    if (argc != 4) {
        fprintf(stderr, "usage: %s MESH.ply OUT.exr OUT.png\n", argv[0]);
        return 2;
    }
    TRUE(helmholtz_version() == 100);
    TRUE(strcmp(helmholtz_last_error(), "") == 0);
    TRUE(strcmp(helmholtz_status_name(HELMHOLTZ_BUSY), "HELMHOLTZ_BUSY") == 0);
    TRUE(strcmp(helmholtz_status_name(HELMHOLTZ_INTERNAL_ERROR), "HELMHOLTZ_INTERNAL_ERROR") == 0);
    TRUE(strcmp(helmholtz_status_name(99), "unknown") == 0);
    loading(argv[1]);
    editing();
    asking();
    rendering(argv[2], argv[3]);
    printf("%d checks, %d failures\n", checks, failures);
    return failures ? 1 : 0;
}
