# Two stages: the build of a virtual environment, and the image that runs it: the
# service, the scheduler and the workers of a cluster alike. Every package is one file with a known
# hash (requirements.txt, by tools/requirements.py), of the version in constraints.txt that the tests
# run with, on this version of Python. For both kinds of machine:
#   docker buildx build --platform linux/amd64,linux/arm64 .
# Neither has been built yet; the tests check the file and the hashes, not the image.
FROM python:3.11-slim AS build
# requirements-slim.txt: the service alone, without pictures, images, DICOM, logins, traces, cluster.
ARG REQUIREMENTS=requirements.txt
WORKDIR /build
COPY requirements.txt requirements-slim.txt requirements-build.txt ./
RUN python -m venv /opt/build /opt/modalmotion \
    && /opt/build/bin/pip install --no-cache-dir --require-hashes --only-binary=:all: -r requirements-build.txt \
    && /opt/modalmotion/bin/pip install --no-cache-dir --require-hashes --only-binary=:all: -r ${REQUIREMENTS}
COPY pyproject.toml README.md LICENSE ./
COPY tools/compile_library.py ./tools/
COPY core ./core
COPY service ./service
RUN /opt/build/bin/pip wheel --no-cache-dir --no-index --no-deps --no-build-isolation --wheel-dir wheels . \
    && /opt/modalmotion/bin/pip install --no-cache-dir --no-index --no-deps wheels/*.whl

FROM python:3.11-slim
# The number is fixed: it owns the files of the volume, whatever image comes after this one.
RUN useradd --system --uid 10001 --home-dir /data --create-home modalmotion
COPY --from=build /opt/modalmotion /opt/modalmotion
# One thread of linear algebra a process: there is a process for each core.
ENV PATH=/opt/modalmotion/bin:$PATH \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    MPLCONFIGDIR=/tmp/matplotlib \
    DASK_TEMPORARY_DIRECTORY=/tmp \
    OMP_NUM_THREADS=1 \
    MODALMOTION_DATA_DIR=/data/results
USER modalmotion
WORKDIR /data
VOLUME /data
EXPOSE 8000
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=30s --timeout=5s --start-period=60s --retries=3 \
    CMD ["python", "-c", "import urllib.request as u; u.urlopen('http://127.0.0.1:8000/health/ready', timeout=4)"]
CMD ["modalmotion", "serve", "--host", "0.0.0.0", "--port", "8000"]
