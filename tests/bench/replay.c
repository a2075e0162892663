/* Replays recorded rays in a bare loop over Embree's C API: the floor under a render's time.
 *
 *   cc -O3 -march=x86-64 -o replay replay.c -I PREFIX/include -L PREFIX/lib -lembree4 -lpthread
 *   replay RECORDING THREADS REPEATS
 *
 * RECORDING is written by `cargo test --release -- --ignored --nocapture benchmark_replay`: little-endian,
 *   u32 meshes, then per mesh u32 vertices, u32 triangles, f32[3] each, u32[3] each;
 *   u64 rays, then per ray f32 origin[3], t_min, direction[3], t_max, u32 occlusion.
 * Prints one line per repeat: seconds, and a checksum of the answers. */
#include <embree4/rtcore.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

typedef struct {
  float o[3], t_min, d[3], t_max;
  uint32_t occlusion;
} Record;

enum { CHUNK = 4096 };

static RTCScene scene;
static Record *records;
static uint64_t record_count;
static atomic_uint_fast64_t next_chunk, checksum;

static void *checked(void *p) {
  if (!p) {
    fputs("replay: out of memory or damaged recording\n", stderr);
    exit(1);
  }
  return p;
}

static void read_all(void *to, size_t size, size_t count, FILE *f) {
  checked(fread(to, size, count, f) == count ? to : NULL);
}

static void *replay(void *unused) {
  uint64_t sum = 0;
  for (;;) {
    uint64_t begin = atomic_fetch_add(&next_chunk, CHUNK);
    if (begin >= record_count) break;
    uint64_t end = begin + CHUNK < record_count ? begin + CHUNK : record_count;
    for (uint64_t i = begin; i < end; i++) {
      const Record *r = &records[i];
      struct RTCRayHit rh;
      rh.ray.org_x = r->o[0], rh.ray.org_y = r->o[1], rh.ray.org_z = r->o[2], rh.ray.tnear = r->t_min;
      rh.ray.dir_x = r->d[0], rh.ray.dir_y = r->d[1], rh.ray.dir_z = r->d[2], rh.ray.tfar = r->t_max;
      rh.ray.time = 0, rh.ray.mask = ~0u, rh.ray.id = 0, rh.ray.flags = 0;
      rh.hit.geomID = RTC_INVALID_GEOMETRY_ID, rh.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
      if (r->occlusion) {
        rtcOccluded1(scene, &rh.ray, NULL);
        sum += rh.ray.tfar < 0;
      } else {
        rtcIntersect1(scene, &rh, NULL);
        sum += rh.hit.primID + 1;
      }
    }
  }
  atomic_fetch_add(&checksum, sum);
  return unused;
}

int main(int argc, char **argv) {
  if (argc != 4) {
    fputs("usage: replay RECORDING THREADS REPEATS\n", stderr);
    return 2;
  }
  FILE *f = checked(fopen(argv[1], "rb"));
  int threads = atoi(argv[2]), repeats = atoi(argv[3]);
  RTCDevice device = rtcNewDevice(NULL);
  scene = rtcNewScene(device);
  rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
  uint32_t meshes;
  read_all(&meshes, sizeof meshes, 1, f);
  for (uint32_t m = 0; m < meshes; m++) {
    uint32_t n[2];
    read_all(n, sizeof *n, 2, f);
    RTCGeometry g = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    float *v = rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, n[0]);
    uint32_t *t = rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, n[1]);
    read_all(v, 12, n[0], f);
    read_all(t, 12, n[1], f);
    rtcCommitGeometry(g);
    rtcAttachGeometry(scene, g);
    rtcReleaseGeometry(g);
  }
  rtcCommitScene(scene);
  read_all(&record_count, sizeof record_count, 1, f);
  records = checked(malloc(record_count * sizeof *records));
  read_all(records, sizeof *records, record_count, f);
  pthread_t *pool = checked(malloc((size_t)threads * sizeof *pool));
  for (int i = 0; i < repeats; i++) {
    struct timespec a, b;
    next_chunk = 0, checksum = 0;
    clock_gettime(CLOCK_MONOTONIC, &a);
    for (int t = 0; t < threads; t++) pthread_create(&pool[t], NULL, replay, NULL);
    for (int t = 0; t < threads; t++) pthread_join(pool[t], NULL);
    clock_gettime(CLOCK_MONOTONIC, &b);
    double s = (double)(b.tv_sec - a.tv_sec) + 1e-9 * (double)(b.tv_nsec - a.tv_nsec);
    printf("%.6f %llu\n", s, (unsigned long long)checksum);
  }
  return 0;
}
