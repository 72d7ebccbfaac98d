# Two stages: the compiler-free build of a virtual environment, and the image that runs it.
FROM python:3.12-slim AS build
WORKDIR /build
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY core ./core
COPY service ./service
RUN python -m venv /opt/modalmotion \
    && /opt/modalmotion/bin/pip install --no-cache-dir -c constraints.txt '.[service,plot]'

FROM python:3.12-slim
RUN useradd --system --uid 10001 --home-dir /data --create-home modalmotion
COPY --from=build /opt/modalmotion /opt/modalmotion
ENV PATH=/opt/modalmotion/bin:$PATH \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONUNBUFFERED=1 \
    MPLCONFIGDIR=/tmp/matplotlib \
    MODALMOTION_DATA_DIR=/data/results
USER modalmotion
VOLUME /data
EXPOSE 8000
HEALTHCHECK --interval=30s --timeout=5s --start-period=20s --retries=3 \
    CMD ["python", "-c", "import urllib.request as u; u.urlopen('http://127.0.0.1:8000/health/ready', timeout=4)"]
CMD ["modalmotion", "serve", "--host", "0.0.0.0", "--port", "8000"]
