/* Stands before pythonfmu's glue library on Linux. The glue takes the place of its resources from a URI of which it
   decodes %20 alone, and crashes where anything else is escaped; here all of it is decoded. Every other function of FMI is
   the glue's own, which this library needs: dlsym finds it there. */
#define _GNU_SOURCE
#include "fmi2Functions.h"

#include <dlfcn.h>
#include <stdlib.h>
#include <string.h>

/* Value of a hexadecimal digit, or -1. */
static int digit(char c)
{
    static const char DIGITS[] = "0123456789abcdef";
    const char low = c >= 'A' && c <= 'F' ? (char)(c - 'A' + 'a') : c;
    const char *found = low ? strchr(DIGITS, low) : 0;
    return found ? (int)(found - DIGITS) : -1;
}

/* The text without its escapes, to be freed; 0 without memory. */
static char *decoded(const char *uri)
{
    char *text = malloc(strlen(uri) + 1), *end = text;
    if (!text)
        return 0;
    while (*uri) {
        const int high = *uri == '%' ? digit(uri[1]) : -1, low = high < 0 ? -1 : digit(uri[2]);
        *end++ = low < 0 ? *uri : (char)(16 * high + low);
        uri += low < 0 ? 1 : 3;
    }
    *end = 0;
    return text;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean logging)
{
    fmi2InstantiateTYPE *glue;
    void *found = dlsym(RTLD_NEXT, "fmi2Instantiate");
    char *place = resources ? decoded(resources) : 0;
    fmi2Component made = 0;
    memcpy(&glue, &found, sizeof glue); /* C has no conversion from an object's pointer to a function's */
    if (glue && place)
        made = glue(name, type, guid, place, host, visible, logging);
    free(place);
    return made;
}
