# docker build -t actioncli .
# docker run --rm -v actions:/data -v "$PWD:/clips:ro" actioncli enroll wave /clips/wave.mp4
# docker run --rm -v actions:/data actioncli watch rtsp://camera.local/stream --mqtt mqtt://broker.local/home
# docker run --rm -v actions:/data --device /dev/video0 --group-add video actioncli watch 0
FROM python:3.13-slim

COPY pyproject.toml README.md LICENSE /source/
COPY actioncli /source/actioncli
COPY weights /source/weights
COPY examples /source/examples
RUN pip install --no-cache-dir '/source[mqtt]' && rm -r /source

# The support set lies in a volume and belongs to this user alone.
RUN useradd --create-home actions && install --directory --owner actions --mode 700 /data
USER actions
ENV ACTIONCLI_HOME=/data
VOLUME /data

ENTRYPOINT ["actioncli"]
CMD ["--help"]
