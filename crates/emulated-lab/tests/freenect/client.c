/*
 * Streams from a Kinect through libfreenect, and writes what its callbacks get, a file an image: client FOLDER COUNT bayer+raw|bayer+mm.
 * Files are bayer-TICKS (8 bits a pixel), raw-TICKS and mm-TICKS (16 bits a pixel, little-endian). Ends after COUNT of each.
 */
#include <libfreenect.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char *folder, *depth_kind;
static long wanted, colours, depths;
static int failed;

static void save(const char *kind, uint32_t ticks, const void *data, size_t length)
{
    char path[4096];
    FILE *file;
    snprintf(path, sizeof path, "%s/%s-%u", folder, kind, (unsigned)ticks);
    file = fopen(path, "wb");
    if (file == NULL || fwrite(data, 1, length, file) != length || fclose(file) != 0) {
        perror(path);
        failed = 1;
    }
}

static void on_colour(freenect_device *device, void *data, uint32_t ticks)
{
    (void)device;
    if (colours < wanted) {
        save("bayer", ticks, data, 640 * 480);
        ++colours;
    }
}

static void on_depth(freenect_device *device, void *data, uint32_t ticks)
{
    (void)device;
    if (depths < wanted) {
        save(depth_kind, ticks, data, 640 * 480 * 2);
        ++depths;
    }
}

static void check(int status, const char *what)
{
    if (status < 0) {
        fprintf(stderr, "client: %s: %d\n", what, status);
        exit(2);
    }
}

int main(int argc, char **argv)
{
    freenect_context *context;
    freenect_device *device;
    freenect_depth_format format;
    if (argc != 4) {
        fprintf(stderr, "client FOLDER COUNT bayer+raw|bayer+mm\n");
        return 2;
    }
    folder = argv[1];
    wanted = strtol(argv[2], NULL, 10);
    depth_kind = strcmp(argv[3], "bayer+mm") == 0 ? "mm" : "raw";
    format = strcmp(depth_kind, "mm") == 0 ? FREENECT_DEPTH_MM : FREENECT_DEPTH_11BIT;

    check(freenect_init(&context, NULL), "freenect_init");
    freenect_select_subdevices(context, FREENECT_DEVICE_CAMERA);
    printf("%d devices\n", freenect_num_devices(context));
    check(freenect_open_device(context, &device, 0), "freenect_open_device");
    check(freenect_set_video_mode(device, freenect_find_video_mode(FREENECT_RESOLUTION_MEDIUM, FREENECT_VIDEO_BAYER)), "video mode");
    check(freenect_set_depth_mode(device, freenect_find_depth_mode(FREENECT_RESOLUTION_MEDIUM, format)), "depth mode");
    freenect_set_video_callback(device, on_colour);
    freenect_set_depth_callback(device, on_depth);
    check(freenect_start_depth(device), "freenect_start_depth");
    check(freenect_start_video(device), "freenect_start_video");
    while (!failed && (colours < wanted || depths < wanted)) {
        check(freenect_process_events(context), "freenect_process_events");
    }
    freenect_stop_video(device);
    freenect_stop_depth(device);
    freenect_close_device(device);
    freenect_shutdown(context);
    printf("%ld colour, %ld depth\n", colours, depths);
    return failed;
}
