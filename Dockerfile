# The simulator, its controller and what marks them. Nothing but Debian's archive and PyPI, so that it builds in years.
#   docker build -t husky .
#   docker run --rm -it --init -p 8080:8080 husky      (the page with the robot: the address it prints)
FROM debian:bookworm-slim
SHELL ["/bin/bash", "-eo", "pipefail", "-c"]
ENV LANG=C.UTF-8 ROS_HOME=/tmp/ros
WORKDIR /husky_highlevel_controller
# what is installed changes seldom: a layer of its own
COPY dev package.xml CMakeLists.txt setup.py ./
COPY requirements requirements
COPY tools tools
RUN bash tools/install_in_image.sh packages
COPY . .
RUN bash tools/install_in_image.sh build
EXPOSE 8080
CMD ["./dev", "launch", "gui:=false", "web:=true", "web_address:=0.0.0.0"]
